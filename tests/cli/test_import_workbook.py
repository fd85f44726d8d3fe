# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Excel workbooks: several sheets, merged and hidden cells, formats, formulas and errors."""

import datetime

import numpy as np
import pytest

from .test_import_silent import (
    EFFICIENCY,
    ENGINE,
    LOAD,
    SHAFTS,
    STROKE,
    TESTS,
    assert_true,
)

openpyxl = pytest.importorskip("openpyxl")
pytest.importorskip("pandas")
NAMES = list(SHAFTS)
ROWS = [[float(value) for value in row] for row in zip(*SHAFTS.values(), strict=True)]
LOAD_NAMES = ["Stroke [%]", "Engine speed [rpm]", "Load torque [Nm]", "Efficiency [%]"]


def fill(sheet, rows):
    for row in rows:
        sheet.append(row)
    return sheet


def imported(hmcvt, tmp_path, book, *options):
    path = tmp_path / "t.xlsx"
    book.save(path)
    return hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes", *options)


def halved():
    """Return rows with torques of half the size."""
    return [[r[0], r[1], 0.5 * r[2], r[3], 0.5 * r[4]] for r in ROWS]


def test_two_sheets_with_such_a_table_are_asked(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    fill(book.active, [NAMES, *halved()])
    fill(book.create_sheet("corrected"), [NAMES, *ROWS])
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 2 and "add --sheet Sheet or --sheet corrected" in done.err
    done = imported(hmcvt, tmp_path, book, "--sheet", "corrected")
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS


def test_a_hidden_sheet_is_passed_over(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    fill(book.active, [NAMES, *ROWS])
    old = fill(book.create_sheet("old"), [NAMES, *halved()])
    old.sheet_state = "hidden"
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS


def test_merged_groups_of_unequal_length(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    sheet = book.active
    groups = ["Test", "Operating point", None, "Engine", None, None, "Output", None]
    names = ["", "Stroke", "Remark", "speed", "torque", "fuel", "speed", "torque"]
    units = ["", "%", "", "rpm", "Nm", "kg/h", "rpm", "Nm"]
    fill(sheet, [groups, names, units])
    for number, row in enumerate(ROWS):
        sheet.append([number, row[0], "", row[1], row[2], 5.0, row[3], row[4]])
    for cells in ("B1:C1", "D1:F1", "G1:H1"):
        sheet.merge_cells(cells)
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


def test_a_merged_group_ends_where_its_cells_do(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    sheet = book.active
    fill(
        sheet, [["Engine", None, None], ["speed [rpm]", "torque [Nm]", "speed 2 [rpm]"]]
    )
    sheet.append([1500, 100, 1600])
    sheet.merge_cells("A1:B1")
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 2 and "'speed 2 [rpm]' does not say which side" in done.err


@pytest.mark.parametrize(
    "names", [LOAD_NAMES, ["Stroke", *LOAD_NAMES[1:3], "Efficiency"]]
)
@pytest.mark.parametrize("formatted", [TESTS, TESTS // 2])
def test_cells_in_a_format_of_percent(hmcvt, tmp_path, names, formatted):
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(names)
    for number in range(TESTS):
        part = 1.0 if number < formatted else 100.0
        sheet.append(
            [
                part * STROKE[number],
                ENGINE[number],
                LOAD[number],
                part * EFFICIENCY[number],
            ]
        )
        if number < formatted:
            sheet.cell(number + 2, 1).number_format = "0.0%"
            sheet.cell(number + 2, 4).number_format = "0.0%"
    done = imported(hmcvt, tmp_path, book)
    if formatted < TESTS and names != LOAD_NAMES:
        names = [f"{name}:%" for name in ("Stroke", "Efficiency")]
        answers = ("--displacement-ratio", names[0], "--efficiency", names[1])
        done = imported(hmcvt, tmp_path, book, *answers)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


def test_a_unit_in_the_format_of_a_number(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Stroke [%]", "Engine speed", "Load torque", "Efficiency [%]"])
    for number in range(TESTS):
        torque = LOAD[number] / 1.3558179483
        sheet.append(
            [100 * STROKE[number], ENGINE[number], torque, 100 * EFFICIENCY[number]]
        )
        sheet.cell(number + 2, 2).number_format = '0" rpm"'
        sheet.cell(number + 2, 3).number_format = '0.0" lb ft"'
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


def test_a_formula_without_a_stored_value_is_named(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    fill(book.active, [NAMES])
    for number, row in enumerate(ROWS, 2):
        book.active.append([*row[:4], f"=C{number}*1"])
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 2 and "is a formula without a stored value" in done.err, done


def test_errors_of_the_sheet_are_named(hmcvt, tmp_path):
    rows = [list(row) for row in ROWS]
    rows[2][4] = "#DIV/0!"
    rows[5][2] = "#N/A"
    book = openpyxl.Workbook()
    fill(book.active, [NAMES, *rows])
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 2 and "row 4: Output torque [Nm] '#DIV/0!'" in done.err, done
    done = imported(hmcvt, tmp_path, book, "--skip-bad")
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS - 2


def test_a_hidden_row_is_no_test(hmcvt, tmp_path):
    rows = [*ROWS[:4], [*ROWS[3][:4], 0.9 * ROWS[3][4]], *ROWS[4:]]
    book = openpyxl.Workbook()
    fill(book.active, [NAMES, *rows])
    book.active.row_dimensions[6].hidden = True
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 2 and "row 6: is hidden in the sheet" in done.err, done
    done = imported(hmcvt, tmp_path, book, "--skip-bad")
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS


def test_a_hidden_column_is_not_proposed(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    fill(book.active, [[*NAMES, "Output torque [Nm] old"]])
    for row in ROWS:
        book.active.append([*row[:4], 0.9 * row[4], row[4]])
    book.active.cell(1, 6, "Output torque of the shaft [Nm]")
    book.active.column_dimensions["E"].hidden = True
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 0 and "the sheet hides it" in done.out, done
    assert assert_true(tmp_path / "bench.csv") == TESTS


def test_text_numbers_are_read_apart_from_the_other_cells(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    fill(book.active, [NAMES])
    for row in ROWS:
        book.active.append([row[0], f"{row[1]:,.0f}".replace(",", "."), *row[2:]])
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 2 and "can be read in two ways" in done.err, done
    done = imported(hmcvt, tmp_path, book, "--decimal", "comma")
    assert done.code == 0, done
    assert assert_true(tmp_path / "bench.csv") == TESTS
    commas = [[f"{value:.2f}".replace(".", ",") for value in row] for row in ROWS]
    book = openpyxl.Workbook()
    fill(book.active, [NAMES, *commas])
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


def test_typed_numbers_do_not_change_with_the_decimal_sign(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    fill(book.active, [NAMES, *np.round(ROWS, 3).tolist()])
    done = imported(hmcvt, tmp_path, book, "--decimal", "comma")
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


def test_dates_in_cells_and_blank_rows_above_the_header(hmcvt, tmp_path):
    book = openpyxl.Workbook()
    sheet = book.active
    fill(sheet, [["Bench report"], [], ["Engine speed", "1500 rpm"], []])
    sheet.append(["Date", "Time", *NAMES])
    for number, row in enumerate(ROWS):
        sheet.append([datetime.date(2026, 11, 26), datetime.time(8 + number, 30), *row])
    done = imported(hmcvt, tmp_path, book)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done

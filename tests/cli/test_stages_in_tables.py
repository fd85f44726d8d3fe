# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import` of tables of several stages: each stage has a speed ratio of its own."""

import csv

import pytest

from .running import ROOT

TABLE = ROOT / "data" / "three_stages.csv"
MISTYPED = 23  # its engine torque is ten times too large
STAGE, STROKE = "Fahrbereich", "Verstellung [%]"
ENGINE_SPEED, ENGINE_TORQUE = "Drehzahl Motor [1/min]", "Drehmoment Motor [Nm]"
OUTPUT_SPEED, OUTPUT_TORQUE = "Drehzahl Abtrieb [1/min]", "Drehmoment Abtrieb [Nm]"
OUTPUT_POWER = "Leistung Abtrieb [kW]"


def value(text):
    return float(text.replace(",", "."))


@pytest.fixture
def tests():
    """Rows of the shipped table, the torque of the output in N m."""
    with TABLE.open(encoding="utf-8") as file:
        file.readline()
        rows = list(csv.DictReader(file, delimiter=";"))
    del rows[MISTYPED - 1]
    for row in rows:
        torque = 1000.0 * value(row.pop("Drehmoment Abtrieb [kNm]"))
        row[OUTPUT_TORQUE] = f"{torque:.1f}".replace(".", ",")
        power = torque * value(row[OUTPUT_SPEED]) / 9549.3
        row[OUTPUT_POWER] = f"{power:.4f}".replace(".", ",")
        shaft_power = value(row[ENGINE_TORQUE]) * value(row[ENGINE_SPEED]) / 9549.3
        row["Wirkungsgrad [%]"] = f"{100 * power / shaft_power:.3f}".replace(".", ",")
    return rows


@pytest.fixture
def imported(hmcvt, tmp_path):
    """Return a function that imports rows under names of columns."""

    def run(rows, names, **renamed):
        path = tmp_path / "table.csv"
        head = [renamed.get(name, name) for name in names]
        lines = [head, *([row[name] for name in names] for row in rows)]
        path.write_text("\n".join(map(";".join, lines)), encoding="utf-8")
        return hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes")

    return run


def assert_refused(done, *words):
    """Exit code 2 and these words in the last line, below the proposal."""
    assert done.code == 2, done
    message = done.err.splitlines()[-1]
    assert message.startswith("hmcvt: error: ")
    for word in words:
        assert word in message, (word, message)


def exchanged(*pairs):
    """Return new names of columns with those of each pair exchanged."""
    names = {}
    for one, other in pairs:
        names[one] = other
        names[other] = one
    return names


SHAFTS = (STAGE, STROKE, ENGINE_SPEED, ENGINE_TORQUE, OUTPUT_SPEED, OUTPUT_TORQUE)
SPEEDS = (ENGINE_SPEED, OUTPUT_SPEED)
TORQUES = (ENGINE_TORQUE, OUTPUT_TORQUE)


def test_the_speed_ratio_is_stated_by_stage(imported, tests):
    done = imported(tests, SHAFTS)
    assert done.code == 0, done.err
    for text in ("in F1 0.0564 at stroke 0.41", "in F2 0.172", "in F3 0.429"):
        assert text in done.out


@pytest.mark.parametrize(
    ("pairs", "exchange"),
    [
        ((SPEEDS, TORQUES), "columns"),
        ((SPEEDS,), "speeds"),
    ],
)
def test_exchanged_shafts_are_named(imported, tests, pairs, exchange):
    done = imported(tests, SHAFTS, **exchanged(*pairs))
    assert_refused(done, f"the {exchange} of the two shafts exchanged")


def test_exchanged_torques_are_named_by_those_rows_that_are_possible(imported, tests):
    done = imported(tests, SHAFTS, **exchanged(TORQUES))
    assert_refused(done, "efficiency")
    possible = [row for row in tests if row[STAGE] == "F2"]
    done = imported(possible, SHAFTS, **exchanged(TORQUES))
    assert_refused(done, "the torques of the two shafts exchanged")


def test_exchanged_speeds_show_without_torques(imported, tests):
    names = (STAGE, STROKE, *SPEEDS, OUTPUT_POWER, "Wirkungsgrad [%]")
    assert imported(tests, names).code == 0
    done = imported(tests, names, **exchanged(SPEEDS))
    assert_refused(done, "engine speed / output speed of stage F2 is a line")


def test_a_mistyped_stroke_is_named_with_its_stage(imported, tests):
    position = next(i for i, row in enumerate(tests) if row[STAGE] == "F3")
    tests[position][STROKE] = "95"
    done = imported(tests, SHAFTS)
    assert_refused(done, f"row {position + 2}: output speed", "the other tests of F3")


@pytest.mark.parametrize("name", ["Gear", "Range", "Fahrstufe", "stage"])
def test_names_of_the_column_of_stages(imported, tests, name):
    done = imported(tests, SHAFTS, **{STAGE: name})
    assert done.code == 0 and "in F3 " in done.out


def test_set_values_below_the_tests_have_no_number(imported, tests):
    for number, row in enumerate(tests, 1):
        row["Prüfpunkt"] = str(number)
    names = ("Prüfpunkt", *SHAFTS)
    assert imported(tests, names).code == 0
    values = dict(zip(SHAFTS, ("F3", "50", "1800", "300", "1620", "300"), strict=True))
    done = imported([*tests, {"Prüfpunkt": "", **values}], names)
    row = len(tests) + 2
    assert_refused(done, f"row {row}: has no number in column 'Prüfpunkt'")


def test_a_gear_efficiency_is_not_that_of_the_transmission(imported, tests):
    """Both stand in the table: the one of the transmission is taken."""
    for row in tests:
        row["Efficiency [%]"] = row["Wirkungsgrad [%]"]
        row["Gear efficiency [%]"] = "97,5"
    names = (*SHAFTS, "Gear efficiency [%]", "Efficiency [%]")
    done = imported(tests, names)
    assert done.code == 0 and "0.8841" in done.out
    done = imported(tests, names, **{"Efficiency [%]": "Wirkungsgrad [%]"})
    assert done.code == 0 and "0.8841" in done.out


def test_a_stroke_in_percent_that_is_a_fraction_is_refused(imported, tests):
    for row in tests:
        row[STROKE] = f"{0.01 * value(row[STROKE]):.2f}".replace(".", ",")
    assert_refused(imported(tests, SHAFTS), "is it a fraction, not percent?")


def test_the_shipped_table_is_identified_by_stage(hmcvt, tmp_path):
    """The test with the typing error is named with its stage, and not drawn."""
    gears = tmp_path / "T.yaml"
    ratios = (0.9, 0.8, 1, 1, 2.6, 2.75, 2.7)
    pairs = []
    for number, ratio in enumerate(ratios, 1):
        pairs += ["--gear-pair", f"Z{number}={ratio}"]
    row = "row=k mechanical=Z1:ring pump=Z2 motor=Z3:sun"
    stages = ["--stage", "F1 layout=hydrostatic pump=Z2 motor=Z6 output=Z7"]
    stages += ["--stage", f"F2 {row} output=Z5:carrier"]
    stages += ["--stage", f"F3 {row} output=Z4:carrier"]
    new = hmcvt(
        "transmission", "new", gears, *pairs, "--planetary-row", "k=2.5", *stages
    )
    assert new.code == 0, new.err
    bench = tmp_path / "bench.csv"
    assert hmcvt("import", TABLE, "--out", bench, "--yes").code == 0
    picture = tmp_path / "fit.svg"
    options = ("--transmission", gears, "--noise", "0.25%", "--picture", picture)
    done = hmcvt("identify", bench, *options)
    assert done.code == 0, done.err
    alone = [line for line in done.out.splitlines() if "alone would" in line]
    assert [line.split()[2] for line in alone] == ["F1", "F2", "F3"]
    row = MISTYPED + 1  # below the header of the bench file
    assert f"row {row} is rejected: it reads 0.05334" in done.out
    assert "(stage F1, displacement ratio 0.4, 188.5 rad/s" in done.out
    drawn = picture.read_text(encoding="utf-8")
    for text in ("fitted, F1 (15)", "fitted, F3 (22)", "not drawn: 1 rejected"):
        assert text in drawn
    refused = hmcvt("diagnose", bench)
    assert_refused(
        refused, "stage 'F2' is not known", "give a transmission or parameter file"
    )


def test_stages_by_other_names_than_the_gears(hmcvt, tmp_path):
    gears = tmp_path / "T.yaml"
    pairs = ("--gear-pair", "a=0.9", "--gear-pair", "b=2.6", "--planetary-row", "k=2.5")
    stages = []
    for number in (1, 2, 3):
        stages += [
            "--stage",
            f"G{number} row=k mechanical=a:ring pump=a motor=b:sun output=b:carrier",
        ]
    assert hmcvt("transmission", "new", gears, *pairs, *stages).code == 0
    done = hmcvt(
        *("import", TABLE, "--out", tmp_path / "bench.csv", "--yes"),
        *("--transmission", gears),
    )
    assert done.code == 2
    assert "the stages are F1, F2, F3, those of" in done.err
    assert "T.yaml G1, G2, G3: name them alike in both files" in done.err

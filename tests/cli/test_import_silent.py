# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables that were once taken without a word, with a value off: each kind of them."""

import re

import numpy as np
import pytest

from hmcvt_core import read_bench
from hmcvt_core.transmission.ranges import RPM

TESTS = 12
RNG = np.random.default_rng(5)
STROKE = np.round(np.linspace(-0.85, 0.9, TESTS)[RNG.permutation(TESTS)], 3)
ENGINE = np.round(RNG.uniform(1000.0, 2100.0, TESTS), 1)
LOAD = RNG.uniform(110.0, 450.0, TESTS)
OUTPUT = ENGINE * (1.2 + 0.37 * STROKE) * RNG.uniform(0.985, 1.0, TESTS)
EFFICIENCY = RNG.uniform(0.66, 0.85, TESTS)
INTO = LOAD / EFFICIENCY
OUT = LOAD * ENGINE / OUTPUT
SHAFTS = {
    "Stroke [%]": 100.0 * STROKE,
    "Input speed [rpm]": ENGINE,
    "Input torque [Nm]": INTO,
    "Output speed [rpm]": OUTPUT,
    "Output torque [Nm]": OUT,
}
LOADS = {
    "Stroke [%]": 100.0 * STROKE,
    "Engine speed [rpm]": ENGINE,
    "Load torque [Nm]": LOAD,
    "Efficiency [%]": 100.0 * EFFICIENCY,
}
WITHOUT_EFFICIENCY = {
    name: values for name, values in LOADS.items() if name != "Efficiency [%]"
}


def text_of(columns, rows_below=()):
    """Return columns as CSV, with further rows below them."""
    lines = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(",".join(cell(value) for value in row))
    for row in rows_below:
        lines.append(",".join(cell(value) for value in row))
    return "\n".join(lines) + "\n"


def cell(value):
    return value if isinstance(value, str) else f"{value:.4f}"


def replaced(columns, old, new, values):
    """Return columns with one of them replaced."""
    changed = {}
    for name, numbers in columns.items():
        if name == old:
            changed[new] = values
        else:
            changed[name] = numbers
    return changed


def imported(hmcvt, tmp_path, text, *options):
    path = tmp_path / "raw.csv"
    path.write_text(text, encoding="utf-8")
    return hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes", *options)


def assert_true(path, rel=1e-3):
    """Compare bench samples with the tests that they are nearest to."""
    samples = read_bench(path)
    tests = np.argmin(np.abs(samples.displacement_ratio[:, None] - STROKE), axis=1)
    assert len(set(tests.tolist())) == len(samples)
    assert samples.displacement_ratio == pytest.approx(STROKE[tests], abs=1e-3)
    assert samples.engine_speed == pytest.approx(ENGINE[tests] * RPM, rel=rel)
    assert samples.load_torque == pytest.approx(LOAD[tests], rel=rel)
    assert samples.efficiency == pytest.approx(EFFICIENCY[tests], rel=rel)
    return len(samples)


EXCHANGED_SPEEDS = {
    **SHAFTS,
    "Input speed [rpm]": OUTPUT,
    "Output speed [rpm]": ENGINE,
}


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (
            {**SHAFTS, "Input torque [Nm]": OUT, "Output torque [Nm]": INTO},
            "check their columns",
        ),
        (EXCHANGED_SPEEDS, "outside 0.01 to 1"),
        (
            {
                **{
                    k: v
                    for k, v in EXCHANGED_SPEEDS.items()
                    if k != "Input torque [Nm]"
                },
                "Efficiency [%]": 100.0 * EFFICIENCY,
            },
            "the two speeds are exchanged",
        ),
    ],
)
def test_exchanged_shafts_are_noticed(hmcvt, tmp_path, columns, words):
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and words in done.err, done


@pytest.mark.parametrize("count", [3, 4])
def test_exchanged_speeds_of_few_tests_are_noticed(hmcvt, tmp_path, count):
    rows = np.argsort(STROKE)[np.linspace(0, len(STROKE) - 1, count).astype(int)]
    columns = {
        "Stroke [%]": 100.0 * STROKE[rows],
        "Input speed [rpm]": OUTPUT[rows],
        "Output speed [rpm]": ENGINE[rows],
        "Output torque [Nm]": LOAD[rows],
        "Efficiency [%]": 100.0 * EFFICIENCY[rows],
    }
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and "two speeds are exchanged" in done.err, done


def test_exchanged_torques_of_a_slow_output_follow_the_ratio(hmcvt, tmp_path):
    ratio = 0.5 + 0.25 * STROKE
    columns = {
        **SHAFTS,
        "Output speed [rpm]": ENGINE * ratio,
        "Input torque [Nm]": LOAD / ratio,
        "Output torque [Nm]": INTO,
    }
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and "torques of the two shafts are exchanged" in done.err
    done = imported(hmcvt, tmp_path, text_of(columns), "--unchecked")
    assert done.code == 0, done


def test_the_answer_states_the_shafts(hmcvt, tmp_path):
    done = imported(hmcvt, tmp_path, text_of(SHAFTS))
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS
    assert "engine shaft: speed 'Input speed [rpm]', torque 'Input torque" in done.out
    assert re.search(
        r"output speed / engine speed is 0\.8\d+ at stroke -0\.85", done.out
    )
    turned = replaced(SHAFTS, "Stroke [%]", "Stroke [%]", -100.0 * STROKE)
    assert (
        "check the sign of the stroke" in imported(hmcvt, tmp_path, text_of(turned)).out
    )


@pytest.mark.parametrize(
    ("name", "full", "answer"),
    [("Stroke [%]", 100.0, "%@50"), ("Stroke", 1.0, "-@0.5")],
)
def test_a_stroke_that_is_never_negative_is_asked(hmcvt, tmp_path, name, full, answer):
    text = text_of(replaced(LOADS, "Stroke [%]", name, full * (0.5 + 0.5 * STROKE)))
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and f"{name}:{answer}" in done.err, done
    done = imported(hmcvt, tmp_path, text, "--displacement-ratio", f"{name}:{answer}")
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS


@pytest.mark.parametrize(
    "label",
    [
        *(
            "set values",
            "Sollwert",
            "Upper limit",
            "Mean",
            "Max.",
            "Average of 12 tests",
        ),
        *("Nominal values", "Grenzwerte", "std", "Vorgabe"),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_a_row_that_says_that_it_is_no_test_is_none(hmcvt, tmp_path, label, first):
    row = [50.0, 1500.0, 300.0, 2077.5, 180.0]
    if first:
        numbers = {"Test": [str(number) for number in range(TESTS)]}
        text = text_of({**numbers, **SHAFTS}, [[label, *row]])
    else:
        text = text_of({**SHAFTS, "Remark": [""] * TESTS}, [[*row, label]])
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and f"row 14: {label!r}" in done.err, done
    done = imported(hmcvt, tmp_path, text, "--skip-bad")
    assert done.code == 0 and f"left out: row 14: {label!r}" in done.out
    assert assert_true(tmp_path / "bench.csv") == TESTS


@pytest.mark.parametrize(
    "statistics",
    [
        (np.std,),
        (np.min,),
        (np.max,),
        (np.median,),
        (np.sum,),
        (np.mean, np.std, np.min, np.max),
    ],
)
@pytest.mark.parametrize("columns", [SHAFTS, LOADS])
def test_statistics_without_a_label_are_no_tests(hmcvt, tmp_path, statistics, columns):
    rows = []
    for statistic in statistics:
        rows.append([float(statistic(values)) for values in columns.values()])
    done = imported(hmcvt, tmp_path, text_of(columns, rows), "--skip-bad")
    assert done.code == 0, done
    assert assert_true(tmp_path / "bench.csv") == TESTS


def test_the_largest_set_values_of_a_grid_are_a_test(hmcvt, tmp_path):
    rng = np.random.default_rng(2)
    lines = ["Stroke [%],Engine speed [rpm],Load torque [Nm],Efficiency [%]"]
    for stroke in (-50, 0, 50):
        for speed in (1000, 1500):
            lines.append(
                f"{stroke},{speed},{100 + speed // 10},{rng.uniform(70, 80):.2f}"
            )
    lines.append("50,1500,250,79.21")
    done = imported(hmcvt, tmp_path, "\n".join(lines))
    assert done.code == 0 and len(read_bench(tmp_path / "bench.csv")) == 7, done


@pytest.mark.parametrize(
    "name",
    [
        *("Gear efficiency [%]", "Planetary efficiency [%]", "eta_mh [%]", "eta_m [%]"),
        *(
            "Rendement volum\u00e9trique [%]",
            "Wirkungsgrad Zahnrad [%]",
            "stage efficiency [%]",
        ),
        *("\u673a\u68b0\u6548\u7387 [%]", "Differential efficiency [%]", "eta_1 [%]"),
        *(
            "Final drive efficiency [%]",
            "Traction efficiency [%]",
            "HST efficiency [%]",
        ),
    ],
)
def test_the_efficiency_of_a_part_is_asked(hmcvt, tmp_path, name):
    columns = {**WITHOUT_EFFICIENCY, name: 100.0 * EFFICIENCY}
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and name in done.err, done
    assert f"--efficiency '{name}:%'" in done.err
    done = imported(hmcvt, tmp_path, text_of(columns), "--efficiency", name)
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS


@pytest.mark.parametrize(
    "suffix",
    ["sd", "rms", "SP", "Vorgabe", "ripple", "left", "2", "B", "\u00b1", "delta"],
)
def test_a_word_that_is_not_known_is_asked(hmcvt, tmp_path, suffix):
    name = f"Output torque {suffix} [Nm]"
    columns = replaced(SHAFTS, "Output torque [Nm]", name, 0.7 * OUT)
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and name in done.err, done
    both = {**SHAFTS, name: 0.7 * OUT}
    assert imported(hmcvt, tmp_path, text_of(both)).code == 0
    assert assert_true(tmp_path / "bench.csv") == TESTS


def test_a_torque_without_unit_beside_units_is_asked(hmcvt, tmp_path):
    columns = replaced(LOADS, "Load torque [Nm]", "Load torque", LOAD / 1.3558179483)
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and "--load-torque 'Load torque:lb ft'" in done.err, done
    done = imported(
        hmcvt, tmp_path, text_of(columns), "--load-torque", "Load torque:lb ft"
    )
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS


def test_a_line_above_names_the_unit_of_torque(hmcvt, tmp_path):
    columns = {name.partition(" [")[0]: values for name, values in SHAFTS.items()}
    text = "All torques in lb ft\n" + text_of(columns)
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "a line above says 'lb'" in done.err, done


@pytest.mark.parametrize(
    ("quantity", "factor", "words"),
    [
        ("Engine speed [rpm]", RPM, "does its unit change within the table"),
        ("Stroke [%]", 0.01, "does its unit change within the table"),
    ],
)
def test_a_unit_that_changes_is_noticed(hmcvt, tmp_path, quantity, factor, words):
    values = LOADS[quantity].copy()
    values[TESTS // 2 :] *= factor
    done = imported(hmcvt, tmp_path, text_of({**LOADS, quantity: values}), "--skip-bad")
    assert done.code == 2 and words in done.err, done


def test_strokes_that_change_to_fractions_are_noticed_among_missing_values(
    hmcvt, tmp_path
):
    stroke = np.array([13.63, -14.13, 41.7, -28.4, 0.98, 0.70, -0.42, 0.42])
    columns = {name: list(values[: len(stroke)]) for name, values in LOADS.items()}
    columns["Stroke [%]"] = list(stroke)
    (torque,) = (name for name in columns if "torque" in name.lower())
    for row in (4, 7):
        columns[torque][row] = "#N/A"
    done = imported(hmcvt, tmp_path, text_of(columns), "--skip-bad")
    assert done.code == 2 and "does its unit change within the table" in done.err, done


def test_a_mistyped_stroke_does_not_fit_its_speeds(hmcvt, tmp_path):
    stroke = 100.0 * STROKE
    stroke[3] *= -1.0
    text = text_of({**SHAFTS, "Stroke [%]": stroke})
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "row 5: output speed / engine speed" in done.err, done
    done = imported(hmcvt, tmp_path, text, "--skip-bad")
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS - 1


def test_a_repeated_header_is_passed_over_and_another_one_is_not(hmcvt, tmp_path):
    lines = text_of(SHAFTS).splitlines()
    repeated = [*lines[:6], lines[0], *lines[6:]]
    done = imported(hmcvt, tmp_path, "\n".join(repeated), "--skip-bad")
    assert done.code == 0 and "row 7: repeats the header" in done.out, done
    assert assert_true(tmp_path / "bench.csv") == TESTS
    other = [*lines[:6], lines[0].replace("Nm", "lb ft"), *lines[6:]]
    done = imported(hmcvt, tmp_path, "\n".join(other), "--skip-bad")
    assert done.code == 2 and "row 7 is a second header" in done.err, done


def test_a_second_row_of_units_is_refused(hmcvt, tmp_path):
    bare = {name.partition(" [")[0]: values for name, values in SHAFTS.items()}
    lines = text_of(bare).splitlines()
    lines.insert(1, "%,rpm,Nm,rpm,Nm")
    same = [*lines[:7], lines[1], *lines[7:]]
    done = imported(hmcvt, tmp_path, "\n".join(same), "--skip-bad")
    assert done.code == 0 and "row 8: repeats the units" in done.out, done
    other = [*lines[:7], "%,rpm,lb ft,rpm,lb ft", *lines[7:]]
    done = imported(hmcvt, tmp_path, "\n".join(other), "--skip-bad")
    assert done.code == 2 and "row 8 is a row of units" in done.err, done


@pytest.mark.parametrize(
    "rows",
    [
        ("%,rpm,lb ft,rpm,lb ft", "{header}"),
        ("{header}", "CH1,CH2,CH3,CH4,CH5", "%,rpm,lb ft,rpm,lb ft"),
        ("{header}", "mean,mean,mean,mean,mean", "%,rpm,lb ft,rpm,lb ft"),
    ],
)
def test_a_row_of_units_stands_above_or_further_below(hmcvt, tmp_path, rows):
    bare = {name.partition(" [")[0]: values for name, values in SHAFTS.items()}
    bare["Input torque"] = INTO / 1.3558179483
    bare["Output torque"] = OUT / 1.3558179483
    header, *tests = text_of(bare).splitlines()
    lines = [row.format(header=header) for row in rows]
    done = imported(hmcvt, tmp_path, "\n".join([*lines, *tests]))
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


@pytest.mark.parametrize("code", ["6553.5", "3276.7", "9.91e37", "#DIV/0!"])
def test_codes_of_loggers_are_no_values(hmcvt, tmp_path, code):
    lines = text_of(LOADS).splitlines()
    fields = lines[4].split(",")
    fields[2] = code
    lines[4] = ",".join(fields)
    done = imported(hmcvt, tmp_path, "\n".join(lines), "--skip-bad")
    assert done.code == 0 and "left out: row 5" in done.out, done
    assert assert_true(tmp_path / "bench.csv") == TESTS - 1


def test_oil_at_zero_among_warm_oil_is_no_value(hmcvt, tmp_path):
    oil = np.full(TESTS, 70.0)
    oil[2] = 0.0
    text = text_of({**SHAFTS, "Oil temp [\u00b0C]": oil})
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "row 4: oil_temperature = 0" in done.err, done


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("Input speed [x1000 rpm]", 1000.0 * RPM),
        ("Input speed [rpm x 1000]", 1000.0 * RPM),
        ("Input speed / x1000 rpm", 1000.0 * RPM),
        ("n_in_radps", 1.0),
        ("n_in_rad_s", 1.0),
    ],
)
def test_units_of_speed_that_were_not_read(hmcvt, tmp_path, name, size):
    columns = replaced(SHAFTS, "Input speed [rpm]", name, ENGINE * RPM / size)
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 0 and assert_true(tmp_path / "bench.csv") == TESTS, done


def test_a_clock_without_seconds_behind_a_date_is_read(hmcvt, tmp_path):
    clock = [
        f"{8 + number // 4:02d}:{15 * (number % 4):02d}" for number in range(TESTS)
    ]
    columns = {"Date": ["2026-11-26"] * TESTS, "Time": clock, **SHAFTS}
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 0, done
    assert np.diff(read_bench(tmp_path / "bench.csv").stamp) == pytest.approx(900.0)


def test_a_column_of_codes_is_named_as_one(hmcvt, tmp_path):
    columns = {**WITHOUT_EFFICIENCY, "Efficiency [%]": ["nan"] * TESTS}
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and "all its cells are codes for no value" in done.err, done


def test_titles_and_blank_cells_above_the_header_of_a_unit(hmcvt, tmp_path):
    path = tmp_path / "unit.csv"
    header = "kind,speed_rpm,pressure_bar,flow_loss_L/min"
    path.write_text(f"Bench 3,,,\n,,,\n{header}\npump,1000,100,2\n")
    done = hmcvt("unit", path)
    assert done.code == 2 and "column displacement is missing" in done.err, done
    path.write_text(f"{header},,\npump,1000,100,2,,\n")
    done = hmcvt("unit", path)
    assert done.code == 2 and "columns 5, 6 have no name" in done.err, done


def test_last_rows_that_lack_what_all_others_have_are_named(hmcvt, tmp_path):
    meters = {
        "Coolant temp [degC]": 80.0 + STROKE,
        "Charge pressure [bar]": 20.0 + STROKE,
    }
    below = [(0.123, 1500.4, 260.2, 77.1, "", "")]
    text = text_of(LOADS | meters, below)
    done = imported(hmcvt, tmp_path, text)
    assert (
        done.code == 2 and "lacks cells in columns that all rows above fill" in done.err
    )
    done = imported(hmcvt, tmp_path, text, "--skip-bad")
    assert done.code == 0, done
    assert len(read_bench(tmp_path / "bench.csv")) == TESTS
    assert_true(tmp_path / "bench.csv")


def test_small_fractions_below_a_stroke_in_percent_are_asked(hmcvt, tmp_path):
    percent = 100.0 * STROKE
    percent[-4:] = [0.0042, 0.0014, -0.0014, -0.0042]
    percent[-4:] *= 100.0
    text = text_of(replaced(LOADS, "Stroke [%]", "Stroke [%]", percent))
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "does its unit change within the table" in done.err, done


def test_a_code_with_a_decimal_comma_leaves_the_neutral_open(hmcvt, tmp_path):
    half = [f"{0.5 + 0.5 * value:.4f}".replace(".", ",") for value in STROKE]
    half[4] = "6553,5"
    columns = replaced(LOADS, "Stroke [%]", "Stroke [-]", half)
    lines = [";".join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(";".join(cell(value).replace(".", ",") for value in row))
    done = imported(hmcvt, tmp_path, "\n".join(lines), "--skip-bad")
    assert done.code == 2 and "in the middle of the range" in done.err, done


def test_a_maximum_of_a_missing_reading_is_no_test(hmcvt, tmp_path):
    torques = [f"{value:.4f}" for value in LOAD]
    torques[3] = ""
    columns = replaced(LOADS, "Load torque [Nm]", "Load torque [Nm]", torques)
    above = [np.max(values) for values in LOADS.values()]
    above[2] = LOAD.max() + 50.0
    below = [np.mean(values) for values in LOADS.values()]
    done = imported(hmcvt, tmp_path, text_of(columns, [above, below]), "--skip-bad")
    assert done.code == 0, done
    assert len(read_bench(tmp_path / "bench.csv")) == TESTS - 1
    assert_true(tmp_path / "bench.csv")


def test_a_test_that_contradicts_its_shafts_is_named(hmcvt, tmp_path):
    stated = 100.0 * EFFICIENCY
    stated[5] *= 0.7
    text = text_of(SHAFTS | {"Efficiency [%]": stated})
    done = imported(hmcvt, tmp_path, text)
    assert done.code == 2 and "row 7: efficiency =" in done.err, done
    done = imported(hmcvt, tmp_path, text, "--skip-bad")
    assert done.code == 0, done
    assert_true(tmp_path / "bench.csv")


def test_a_misread_sign_in_a_name_is_asked(hmcvt, tmp_path):
    columns = replaced(
        SHAFTS, "Output torque [Nm]", "\u00a6\u00a4 Output torque [Nm]", OUT
    )
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and "is not known" in done.err, done


def test_an_output_speed_without_a_unit_may_be_in_radians(hmcvt, tmp_path):
    columns = {
        "stroke": 100.0 * STROKE,
        "engine speed": ENGINE,
        "output speed": 1.3 * OUTPUT * RPM,
        "output torque": OUT / 1.3,
        "efficiency": 100.0 * EFFICIENCY,
    }
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2
    assert "column 'output speed' names no unit" in done.err


def test_averages_below_do_not_hide_an_efficiency_of_something_else(hmcvt, tmp_path):
    """Four of twelve tests contradict the shafts; six rows of averages agree with them."""
    off = np.where(np.arange(TESTS) % 3 == 0, 0.8, 1.0)
    columns = {"Nr": np.arange(1.0, TESTS + 1.0), **SHAFTS}
    columns["Efficiency [%]"] = 100.0 * off * EFFICIENCY
    means = [np.mean(values) for values in SHAFTS.values()]
    of_means = 100.0 * means[4] * means[3] / means[2] / means[1]
    below = [("", *means, of_means)] * 6
    done = imported(hmcvt, tmp_path, text_of(columns, below), "--skip-bad")
    assert done.code == 2 and "one column or unit is wrong" in done.err, done


@pytest.mark.parametrize("name", ["T_load", "T_load [qx]"])
def test_letter_that_may_be_the_load_torque_is_asked(hmcvt, tmp_path, name):
    columns = {
        "Stroke [%]": 100.0 * STROKE,
        "Engine speed [rpm]": ENGINE,
        "Engine torque [Nm]": INTO,
        "Efficiency [%]": 90.0 * EFFICIENCY,
        name: LOAD,
    }
    done = imported(hmcvt, tmp_path, text_of(columns))
    assert done.code == 2 and f"--load-torque '{name}:N m'" in done.err, done
    as_oil = ("--oil-temperature", f"{name}:degF")
    done = imported(hmcvt, tmp_path, text_of(columns), *as_oil)
    assert "may be a torque" not in done.err, done
    columns["Efficiency [%]"] = 100.0 * EFFICIENCY
    text = text_of(columns)
    done = imported(hmcvt, tmp_path, text, "--efficiency", "Efficiency [%]")
    assert done.code == 0, done
    assert assert_true(tmp_path / "bench.csv") == TESTS

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Hostile tables: a value that can mean two things is asked, never taken silently."""

import numpy as np
import pytest

from hmcvt_core import load_model, read_bench
from hmcvt_core.transmission.ranges import RPM

from .running import HM4

TESTS = 8
RNG = np.random.default_rng(3)
STROKE = np.round(np.linspace(-0.8, 0.9, TESTS)[RNG.permutation(TESTS)], 2)
ENGINE = np.round(RNG.uniform(900.0, 2100.0, TESTS))
LOAD = RNG.uniform(90.0, 400.0, TESTS)
MODEL = load_model(HM4)
EFFICIENCY = MODEL.efficiency(STROKE, ENGINE * RPM, LOAD)
OUTPUT = MODEL.output_speed(STROKE, ENGINE * RPM, LOAD) / RPM
COLUMNS = {
    "Stroke [%]": 100.0 * STROKE,
    "Input speed [rpm]": ENGINE,
    "Input torque [Nm]": LOAD / EFFICIENCY,
    "Output speed [rpm]": OUTPUT,
    "Output torque [Nm]": LOAD * ENGINE / OUTPUT,
}
WITH_EFFICIENCY = {
    "Stroke [%]": 100.0 * STROKE,
    "Engine speed [rpm]": ENGINE,
    "Load torque [Nm]": LOAD,
}
TURNS_PER_SECOND = {
    "stroke": STROKE,
    "n_in": ENGINE / 60.0,
    "M_in": COLUMNS["Input torque [Nm]"],
    "n_out": OUTPUT / 60.0,
    "M_out": COLUMNS["Output torque [Nm]"],
}


def replaced(old, new, values):
    """Return the columns of the two shafts with one of them replaced."""
    columns = {}
    for name, numbers in COLUMNS.items():
        if name == old:
            columns[new] = values
        else:
            columns[name] = numbers
    return columns


def write(path, columns, minus="-", footer=""):
    cells = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        cells.append(",".join(f"{number:.5f}" for number in row).replace("-", minus))
    path.write_text("\n".join(cells) + f"\n{footer}", encoding="utf-8")
    return path


def imported(hmcvt, tmp_path, *options, **table):
    path = write(tmp_path / "raw.csv", **table)
    return hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes", *options)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (
            {**WITH_EFFICIENCY, "eta pump [%]": 100.0 * EFFICIENCY},
            "efficiency (or engine_torque",
        ),
        (
            {**WITH_EFFICIENCY, "Engine efficiency [%]": 100.0 * EFFICIENCY},
            "efficiency (or engine_torque",
        ),
        (
            {**WITH_EFFICIENCY, "Hydrostatic efficiency [%]": 100.0 * EFFICIENCY},
            "efficiency (or engine_torque",
        ),
        (
            {**WITH_EFFICIENCY, "Predicted efficiency [%]": 100.0 * EFFICIENCY},
            "efficiency (or engine_torque",
        ),
        (replaced("Stroke [%]", "Swash angle", 17.0 * STROKE), "angle or a length"),
        (replaced("Stroke [%]", "Hub", 22.0 * STROKE), "angle or a length"),
        (replaced("Stroke [%]", "alpha", 90.0 * STROKE), "angle or a length"),
        (TURNS_PER_SECOND, "turns per second"),
        (
            replaced(
                "Output torque [Nm]", "Load torque [Nm]", COLUMNS["Output torque [Nm]"]
            ),
            "may be the torque at the output shaft",
        ),
        (
            replaced("Output torque [Nm]", "Output torque sim [Nm]", LOAD),
            "load_torque",
        ),
    ],
)
def test_what_may_be_another_quantity_is_asked(hmcvt, tmp_path, columns, words):
    done = imported(hmcvt, tmp_path, columns=columns)
    assert done.code == 2 and words in done.err, done


def test_a_power_without_unit_is_asked(hmcvt, tmp_path):
    horsepower = LOAD * ENGINE * RPM / EFFICIENCY / 745.7
    columns = replaced("Input torque [Nm]", "Input power", horsepower)
    done = imported(hmcvt, tmp_path, columns=columns)
    assert done.code == 2 and "'Input power' names no unit" in done.err, done
    done = imported(
        hmcvt, tmp_path, "--engine-power", "Input power:hp", columns=columns
    )
    assert done.code == 0, done
    assert read_bench(tmp_path / "bench.csv").efficiency == pytest.approx(
        EFFICIENCY, rel=1e-4
    )


def test_turns_per_second_are_offered(hmcvt, tmp_path):
    columns = replaced("Input speed [rpm]", "Input speed [Hz]", ENGINE / 60.0)
    done = imported(hmcvt, tmp_path, columns=columns)
    answer = "Input speed [Hz]:turn/s"
    assert done.code == 2 and answer in done.err, done
    done = imported(hmcvt, tmp_path, "--engine-speed", answer, columns=columns)
    assert done.code == 0, done
    speed = read_bench(tmp_path / "bench.csv").engine_speed
    assert speed == pytest.approx(ENGINE * RPM, rel=1e-4)


@pytest.mark.parametrize(
    "name", ["HP", "High pressure", "System pressure", "Barometric_Pressure"]
)
def test_the_pressure_of_one_side_is_no_difference(hmcvt, tmp_path, name):
    columns = {**COLUMNS, f"{name} [bar]": 25.0 + LOAD}
    assert imported(hmcvt, tmp_path, columns=columns).code == 0
    assert read_bench(tmp_path / "bench.csv").pressure is None


def test_the_pressures_of_two_ports_are_no_difference(hmcvt, tmp_path):
    ports = {"Pressure A [bar]": 25.0 + LOAD, "Pressure B [bar]": np.full(TESTS, 25.0)}
    done = imported(hmcvt, tmp_path, columns={**COLUMNS, **ports})
    assert done.code == 0 and "pressure of one side" in done.out + done.err, done
    assert read_bench(tmp_path / "bench.csv").pressure is None


def test_a_difference_of_the_system_is_taken(hmcvt, tmp_path):
    columns = {**COLUMNS, "System dp [bar]": LOAD}
    assert imported(hmcvt, tmp_path, columns=columns).code == 0
    pressure = read_bench(tmp_path / "bench.csv").pressure
    assert pressure == pytest.approx(1e5 * LOAD, rel=1e-4)


@pytest.mark.parametrize("minus", ["\u2212", "\u2013"])
def test_a_typographic_minus_is_a_minus(hmcvt, tmp_path, minus):
    assert imported(hmcvt, tmp_path, columns=COLUMNS, minus=minus).code == 0
    ratio = read_bench(tmp_path / "bench.csv").displacement_ratio
    assert ratio == pytest.approx(STROKE)


def test_a_minus_behind_a_number_is_no_unit(hmcvt, tmp_path):
    path = write(tmp_path / "raw.csv", replaced("Stroke [%]", "stroke", STROKE))
    lines = []
    for line in path.read_text().splitlines():
        first, rest = line.split(",", 1)
        lines.append(f"{first[1:]}-,{rest}" if first[0] == "-" else line)
    path.write_text("\n".join(lines))
    done = hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes")
    assert done.code == 2 and "is not a number" in done.err, done


def test_an_unnamed_row_of_means_is_no_test(hmcvt, tmp_path):
    means = ",".join(f"{np.mean(numbers):.4f}" for numbers in COLUMNS.values())
    done = imported(hmcvt, tmp_path, columns=COLUMNS, footer=means)
    assert done.code == 2 and "row 10: is the mean of the rows above" in done.err, done
    done = imported(hmcvt, tmp_path, "--skip-bad", columns=COLUMNS, footer=means)
    assert done.code == 0 and len(read_bench(tmp_path / "bench.csv")) == TESTS


def test_second_speed_with_an_unknown_unit_is_asked(hmcvt, tmp_path):
    columns = {"giri motore [qx]": 0.9 * ENGINE, **COLUMNS}
    path = write(tmp_path / "raw.csv", columns)
    done = hmcvt("import", path, "--out", tmp_path / "bench.csv", "--yes")
    assert done.code == 2
    assert "giri motore [qx]" in done.err
    assert not (tmp_path / "bench.csv").exists()

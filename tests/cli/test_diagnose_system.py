# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt diagnose-system`: any simulator and a table of its readings."""

import numpy as np
import pytest

from cli.running import ROOT, assert_refused, run
from hmcvt_core.files.table import csv_text
from tests.diagnosis.test_simulator import diagnosed, drive

DRIVE = f"{ROOT / 'examples' / 'electric_drive.py'}:system"
NOISE = ("--noise", "battery_power=15", "--noise", "phase_current=0.15")


def table(path, *, without=(), **more):
    points, readings = drive()["campaign"](seed=1, magnet_weakening=0.04)
    columns = {**points, **readings, **more}
    kept = {name: row for name, row in columns.items() if name not in without}
    path.write_text(csv_text(kept), encoding="utf-8")
    return str(path)


def test_answer_is_that_of_the_library(tmp_path):
    bench = table(tmp_path / "bench.csv")
    done = run("diagnose-system", DRIVE, bench, *NOISE, "--json")
    assert done.code == 0, done.err
    assert done.json["sets"][0]["effects"] == ["magnet_weakening"]
    size = done.json["causes"][0]["parameters"]["magnet_weakening"]["value"]
    expected = diagnosed().causes[0].parameters["magnet_weakening"]["value"]
    assert size == pytest.approx(expected, rel=1e-6)


def test_report_names_columns_that_are_not_used(tmp_path):
    bench = table(
        tmp_path / "bench.csv",
        operator=["AB"] * 60,
        battery_power_std=np.full(60, 15.0),
    )
    page = tmp_path / "drive.html"
    done = run("diagnose-system", DRIVE, bench, "--report", str(page))
    assert done.code == 0, done.err
    assert "Probably magnet weakening" in done.out
    assert "neither axis nor channel of the system: operator" in " ".join(
        done.out.split()
    )
    assert "magnet weakening" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("examples", "write module:NAME or file.py:NAME"),
        ("no_such_module:DRIVE", "no_such_module: cannot be loaded"),
        ("{example}:NONE", "holds no NONE; there is"),
        ("{example}:TORQUE_CONSTANT", "is a float, no system"),
        ("{example}:campaign", "cannot be called: TypeError"),
        ("json:JSONDecoder", "is no system: axes, channels"),
    ],
)
def test_what_is_no_system_is_refused(tmp_path, target, message):
    bench = table(tmp_path / "bench.csv")
    target = target.format(example=ROOT / "examples" / "electric_drive.py")
    assert_refused(run("diagnose-system", target, bench), message)


def test_wrong_tables_and_noise_are_refused(tmp_path):
    short = table(tmp_path / "short.csv", without=("speed",))
    assert_refused(run("diagnose-system", DRIVE, short), "column speed is missing")
    bench = table(tmp_path / "bench.csv")
    assert_refused(
        run("diagnose-system", DRIVE, bench, "--noise", "flow=1"),
        "no such channel; it has phase_current, battery_power",
    )
    assert_refused(
        run("diagnose-system", DRIVE, bench, "--noise", "battery_power"),
        "write CHANNEL=STD",
    )
    assert_refused(
        run("diagnose-system", DRIVE, bench, "--noise", "battery_power=0"),
        "a standard deviation is above 0",
    )

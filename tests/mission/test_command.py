# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt mission`: text, JSON, files."""

import csv
from dataclasses import replace

import pytest
from cli.running import assert_refused, run

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import FanDrive

HEADER = "time,output_speed,output_power\n"
ROWS = "".join(f"{i},{60 + i % 3},{4e4 + 100 * i}\n" for i in range(20))


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text(HEADER + ROWS)
    return file


def test_json_holds_what_is_promised(path):
    value = run("mission", path, "--bound", "--json").json
    assert value["strategy"] == "causal"
    assert 0.0 < value["bound"] <= value["fuel"]
    assert value["above_bound"] == pytest.approx(value["fuel"] / value["bound"] - 1.0)
    assert value["bound_error"] >= 0.0
    assert {"engine", "useful", "losses", "lost"} <= value["energy"].keys()
    assert isinstance(value["shifts"], int)
    without = run("mission", path, "--json").json
    assert without["bound"] is None and without["above_bound"] is None


def test_text_names_what_cannot_be_met(path):
    path.write_text(HEADER + ROWS + "20,60,150000\n")
    done = run("mission", path)
    assert done.code == 0
    assert "demand not met at 1 steps:\n  20 s: beyond the engine" in done.out


def test_files(path, tmp_path):
    series = tmp_path / "series.csv"
    page = tmp_path / "m.html"
    done = run(
        "mission", path, "--compare", "--out", series, "--report", page, "--bound"
    )
    assert done.code == 0, done.err
    assert "fixed_speed" in done.out
    rows = list(csv.DictReader(series.read_text().splitlines()))
    assert len(rows) == 20 and rows[0]["stage"] in ("HM2", "HM3")
    assert float(rows[0]["loss_leakage"]) > 0.0
    text = page.read_text(encoding="utf-8")
    assert text.count("<svg") == 3 and "engine_line" in text
    for shows in ("course", "flow", "strategies"):
        picture = tmp_path / f"{shows}.svg"
        done = run("mission", path, "--shows", shows, "--picture", picture)
        assert done.code == 0, done.err
        assert "<svg" in picture.read_text(encoding="utf-8")


def test_the_oil_temperature_that_is_assumed_is_stated(path, tmp_path):
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    params = tmp_path / "drags.yaml"
    hmcvt.save_model(replace(model, effects=(FanDrive(torque=5.0),)), params)
    done = run("mission", path, "--params", params)
    assert done.err == "note: without an oil temperature, effect fan_drive is off\n"


def test_bad_input_is_refused(path, tmp_path):
    assert_refused(run("mission", tmp_path / "no.csv"), "no.csv")
    assert_refused(run("mission", path, "--strategy", "best"), "strategy 'best'")
    assert_refused(run("mission", path, "--step", "0"), "step = 0 s")
    assert_refused(run("mission", path, "--out", path), "read by this command")
    assert_refused(
        run("mission", path, "--report", tmp_path / "r.pdf"), "ends in .html"
    )
    path.write_text(HEADER + "0,60,400000\n1,60,400000\n")
    assert_refused(run("mission", path), "no step can be driven; 0 s: beyond")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a command says beside its answer: copies, stalls, oil temperature, errors of meters."""

from dataclasses import replace
from pathlib import Path

import pytest

import hmcvt_core as hmcvt_library
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_core.physics.effects.sensor import EngineTorqueGain

from .running import HM4, POINT, TABLE2

TABLE = Path(TABLE2)
HEADER = "displacement_ratio,engine_speed,load_torque,efficiency\n"


def saved(path, *effects):
    model = hmcvt_library.load_model(HM4)
    hmcvt_library.save_model(replace(model, effects=effects), path)
    return path


@pytest.fixture
def with_a_stall(tmp_path):
    bench = tmp_path / "bench.csv"
    rows = "".join(",".join(line.split(",")[1:5]) + "\n"
                   for line in TABLE.read_text().splitlines()[1:])
    bench.write_text(f"{HEADER}{rows}-1,20,2000,0.3\n")
    return bench


def test_held_back_sample_that_stalls_is_counted(hmcvt, tmp_path, with_a_stall):
    out = tmp_path / "model.yaml"
    done = hmcvt("identify", with_a_stall, "--fit", "1,2,4-6", "--out", out)
    assert "no answer at 1 of 4 samples held back" in done.out and "nan" not in done.out
    assert ".nan" not in out.read_text()
    stated = hmcvt_library.load_model(out).provenance
    assert (stated["validation_samples"], stated["validation_without_answer"]) == (4, 1)
    # The mean is that of the paper's three.
    assert stated["prediction_error"] == pytest.approx(0.0160, abs=1e-4)


def test_copied_rows_are_told(hmcvt, tmp_path):
    text, bench = TABLE.read_text(), tmp_path / "copied.csv"
    bench.write_text(text + "".join(text.splitlines(keepends=True)[1:]))
    assert "8 of 16 samples copy another one" in hmcvt("identify", bench).out
    assert "copy" not in hmcvt("identify", TABLE2).out
    bench.write_text(HEADER + 12 * "0.5,150,200,0.8\n")
    assert "12 samples at 1 working point cannot determine 3" in hmcvt("identify", bench).out


@pytest.mark.parametrize("command", ["predict", "breakdown"])
def test_oil_temperature_without_effect_is_told(hmcvt, command):
    done = hmcvt(command, *POINT, "--oil-temperature", "20", "--json")
    assert done.code == 0 and done.json["efficiency"] > 0.0
    assert done.err == ("note: this model has no effect of the oil temperature; --oil-temperature "
                        "changes nothing\n")
    assert hmcvt(command, *POINT).err == ""


@pytest.mark.parametrize("command", [
    ("predict", *POINT), ("breakdown", *POINT), ("optimum", *POINT[2:]),
    ("map", "--steps", "2", "2", "2")], ids=lambda command: command[0])
def test_oil_temperature_that_is_assumed_is_told(hmcvt, tmp_path, command):
    warm = saved(tmp_path / "warm.yaml", OilTemperature(1.0))
    assert "60 deg C" in hmcvt(*command, "--params", warm).err
    if command[0] in ("predict", "breakdown"):
        assert hmcvt(*command, "--params", warm, "--oil-temperature", "40").err == ""


def test_error_of_a_meter_is_in_predictions_for_a_bench_alone(hmcvt, tmp_path):
    off = saved(tmp_path / "off.yaml", EngineTorqueGain(-0.1))
    for command in (("predict", *POINT), ("breakdown", *POINT), ("optimum", *POINT[2:])):
        true, read = (hmcvt(*command, "--params", path, "--json").json["efficiency"]
                      for path in (HM4, off))
        assert read == pytest.approx(true, rel=1e-12)
    for true, read in zip(*(hmcvt("predict", TABLE2, "--params", path, "--json").json
                            for path in (HM4, off)), strict=True):
        assert read["predicted"] == pytest.approx(true["predicted"] / 0.9, rel=1e-6)

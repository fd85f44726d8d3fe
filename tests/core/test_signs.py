# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Signs of output speed and pressure: judged by stage, refused and corrected."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.model.signs import (
    require_signs,
    sign_problems,
    signs_by_stage,
    with_corrected_signs,
)

from .test_clutches import two_stages


def machine():
    """A machine of two forward stages and one of reverse that passes standstill."""
    data = two_stages()
    data["gear_pairs"]["R"] = 4.0
    data["clutches"] = {}
    first, *others = hmcvt.transmission.stage.stages_from_mapping(data)
    parameters = hmcvt.HydraulicParameters(3e-11, 0.1, 0.1)
    return hmcvt.EfficiencyModel(first, parameters, other_stages=tuple(others))


MODEL = machine()


def bench():
    """Readings of the machine itself, six in each stage."""
    names = np.repeat(["F1", "F2", "R"], 6)
    strokes = np.tile([-0.9, -0.6, -0.3, 0.0, 0.1, 0.2], 3)
    points = hmcvt.transmission.ranges.OperatingPoints.checked(
        (strokes, np.full(18, 157.0), np.where(names == "R", 60.0, 250.0)), stage=names
    )
    read = MODEL.readings_at(points)
    return hmcvt.BenchSamples(
        displacement_ratio=strokes,
        engine_speed=points.engine_speed,
        load_torque=points.load_torque,
        efficiency=read["efficiency"],
        output_speed=read["output_speed"],
        pressure=read["pressure"],
        extra={"stage": tuple(names)},
    )


SAMPLES = bench()
REVERSE = np.array(SAMPLES.extra["stage"]) == "R"


def test_reverse_is_negative_and_right_signs_stay():
    assert (SAMPLES.output_speed[REVERSE] < 0.0).all()
    assert (SAMPLES.output_speed[~REVERSE] > 0.0).all()
    corrected, found = with_corrected_signs(MODEL, SAMPLES)
    assert {item.output_speed for item in found} == {"right"}
    assert {item.pressure for item in found} == {"right"}
    np.testing.assert_array_equal(corrected.output_speed, SAMPLES.output_speed)
    require_signs(MODEL, SAMPLES)


def test_a_speed_without_sense_is_refused_and_corrected():
    wrong = replace(SAMPLES, output_speed=np.abs(SAMPLES.output_speed))
    (problem,) = sign_problems(signs_by_stage(MODEL, wrong))
    assert problem.startswith("output_speed in stage R turns against the gear train")
    with pytest.raises(hmcvt.InputError, match="`hmcvt transmission signs`"):
        hmcvt.diagnose(MODEL, wrong, noise=0.004)
    with pytest.raises(hmcvt.InputError, match="output_speed in stage R"):
        hmcvt.next_test(MODEL, wrong, noise=0.004)
    corrected, _ = with_corrected_signs(MODEL, wrong)
    np.testing.assert_array_equal(corrected.output_speed, SAMPLES.output_speed)


def test_port_a_less_port_b_is_refused_and_corrected():
    flipped = np.array(SAMPLES.extra["stage"]) == "F2"
    ports = np.where(flipped, -SAMPLES.pressure, SAMPLES.pressure)
    wrong = replace(SAMPLES, pressure=ports)
    with pytest.raises(hmcvt.InputError, match=r"pressure in stage F2 .* port A less"):
        hmcvt.diagnose(MODEL, wrong, noise=0.004)
    corrected, _ = with_corrected_signs(MODEL, wrong)
    np.testing.assert_array_equal(corrected.pressure, SAMPLES.pressure)


def test_a_stage_that_contradicts_itself_is_not_changed():
    speed = SAMPLES.output_speed.copy()
    speed[np.flatnonzero(REVERSE)[:3]] *= -1.0
    wrong = replace(SAMPLES, output_speed=speed)
    corrected, found = with_corrected_signs(MODEL, wrong)
    assert {item.stage: item.output_speed for item in found}["R"] == "mixed"
    np.testing.assert_array_equal(corrected.output_speed, speed)


def test_a_speed_near_zero_is_refused_in_either_sense():
    for speed in (0.05, -0.05, 1500.0, -1500.0):
        values = SAMPLES.output_speed.copy()
        values[0] = speed
        with pytest.raises(
            hmcvt.InputError, match=r"allowed|outside 0\.1 to 1000 rad/s, negative"
        ):
            replace(SAMPLES, output_speed=values)


def test_signed_speeds_survive_a_file(tmp_path):
    hmcvt.write_bench(tmp_path / "bench.csv", SAMPLES)
    again = hmcvt.read_bench(tmp_path / "bench.csv")
    np.testing.assert_array_equal(again.output_speed, SAMPLES.output_speed)


@pytest.mark.parametrize("value", [-0.01, 1.5, float("nan")])
def test_hysteresis_is_a_part(value):
    with pytest.raises(hmcvt.InputError, match="hysteresis"):
        MODEL.optimal_drive(40.0, 3e4, stage="F1", hysteresis=value)

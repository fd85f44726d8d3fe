# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A campaign over several stages settles what one stage cannot."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import words
from hmcvt_core.physics.effects.mechanical import GearEfficiency

TRACTOR = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
NOISE = 0.004


def bench(names, count, seed=3):
    rng = np.random.default_rng(seed)
    stage = np.repeat(names, count)
    stroke, speed, torque = (rng.uniform(*ends, len(stage)) for ends in (
        (-1.0, 1.0), (80.0, 220.0), (80.0, 350.0)))
    worn = replace(TRACTOR, effects=(GearEfficiency(0.01),))
    efficiency = worn.efficiency(stroke, speed, torque, stage=stage)
    read = efficiency + rng.normal(0.0, NOISE, len(stage))
    return hmcvt.BenchSamples(stroke, speed, torque, read,
                              extra={"stage": tuple(stage.tolist())})


@pytest.mark.slow
def test_gears_and_a_torque_meter_are_twins_in_one_stage_and_not_in_three():
    """Worse gears and the gain of a meter: HM1 has more pairs than HM4, the meter is the same."""
    one = hmcvt.diagnose(TRACTOR, bench(("HM4",), 48), noise=NOISE)
    assert one.verdict == "ambiguous"
    assert {cause.effect for cause in one.causes[:2]} == {"gear_mesh", "torque_sensor"}
    three = hmcvt.diagnose(TRACTOR, bench(("HM1", "HM3", "HM4"), 16), noise=NOISE)
    assert three.verdict == "cause_found" and three.causes[0].effect == "gear_mesh"
    assert three.causes[0].probability > 0.95
    assert list(three.model.stages) == list(TRACTOR.stages)


def test_a_sample_without_its_stage_is_named():
    samples = bench(("HM1", "HM4"), 6)
    with pytest.raises(hmcvt.InputError, match="column stage is missing; the model has H0, HM1"):
        hmcvt.diagnose(TRACTOR, replace(samples, extra={}), noise=NOISE)
    wrong = ("HM9", *samples.extra["stage"][1:])
    with pytest.raises(hmcvt.InputError, match="stage 'HM9' is not known to the model"):
        hmcvt.diagnose(TRACTOR, replace(samples, extra={"stage": wrong}), noise=NOISE)


def test_the_next_test_names_its_stage():
    found = hmcvt.next_test(TRACTOR, bench(("HM1", "HM4"), 12), noise=NOISE)
    told = found.to_dict()["test"]
    assert told["stage"] in ("HM1", "HM4")
    assert f"stage {told['stage']}" in words.advice(found)
    point = [told[name] for name in ("displacement_ratio", "engine_speed", "load_torque")]
    assert np.isfinite(TRACTOR.efficiency(*point, stage=told["stage"]))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An output speed that the gear train rules out is told."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission
from hmcvt_core.model.agreement import output_speed_remark


@pytest.fixture(scope="module")
def samples():
    return hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))


@pytest.mark.parametrize(("change", "words"), [
    (lambda s: {"output_speed": s.output_speed * 3.0}, "2.9"),
    (lambda s: {"displacement_ratio": -s.displacement_ratio}, "sign of the displacement ratio"),
    (lambda s: {"output_speed": s.engine_speed}, "check its unit and column"),
])
def test_mistakes_are_told(samples, hm4, change, words):
    assert output_speed_remark(hm4, samples) is None
    wrong = replace(samples, **change(samples))
    remark = output_speed_remark(hm4, wrong)
    assert words in remark
    assert remark in hmcvt.identify(wrong).warnings


def test_an_outlier_and_slip_are_no_mistake(samples, hm4):
    speed = 0.95 * samples.output_speed
    speed[3] *= 3.0
    assert output_speed_remark(hm4, replace(samples, output_speed=speed)) is None


def test_nothing_is_said_without_the_channel_or_next_to_standstill(samples, hm4):
    assert output_speed_remark(hm4, replace(samples, output_speed=None)) is None
    # A pump ten times as large turns the output back at full stroke.
    units = replace(hm4.pump_motor, pump_displacement=10.0 * hm4.pump_motor.pump_displacement)
    still = replace(samples, displacement_ratio=np.full(len(samples), -1.0))
    assert output_speed_remark(replace(hm4, pump_motor=units), still) is None


def test_diagnosis_says_it_too(samples):
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    wrong = replace(samples, output_speed=3.0 * samples.output_speed)
    assert any("times that of gear train" in note for note in Transmission(model).remarks(wrong))

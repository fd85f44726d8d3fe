# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The torque of the pump shaft as a channel: it tells a charge pump from bearing drag."""

from dataclasses import replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import ChargePump

from .campaigns import BASE, campaign


def test_the_pump_torque_settles_a_charge_pump():
    effects = (ChargePump(torque=6.0),)
    samples = campaign(effects, seed=1, n=60, noise=0.004)
    without = hmcvt.diagnose(BASE, samples, noise=0.004)
    assert without.verdict == "ambiguous"
    truth = replace(BASE, effects=effects)
    torque = truth.readings_at(samples.points)[3]
    noise = 0.3 * np.random.default_rng(1).standard_normal(len(samples))
    read = replace(samples, pump_torque=torque + noise)
    found = hmcvt.diagnose(BASE, read, noise=0.004)
    assert found.verdict == "cause_found"
    assert found.causes[0].effect == "charge_pump"
    without_names = {name for item in without.sets for name in item.effects}
    assert {"bearing_drag", "charge_pump"} <= without_names

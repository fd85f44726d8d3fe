# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A pump compared with its sound state, on flow alone."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core.benches.unit import diagnose_unit
from hmcvt_core.benches.unit.samples import UnitSamples
from hmcvt_core.diagnosis.results.outcome import NAMING
from hmcvt_core.errors import InputError

from .bench import CM3, LEAKAGE, TURN, grid


def pump(seed, further=0.0, rubbing=None, levels=6, bypass=0.0):
    """Tests of a pump with 0.4 % noise and further leakage / `LEAKAGE`.

    Where `rubbing` is a constant torque [N m], the torque is read too. `bypass` is the flow of a
    leak at 400 bar [m3/s], whose form no effect has exactly.
    """
    speed, pressure = grid(levels)
    w, p = speed * TURN / 60.0, pressure * 1e5
    size = CM3 * 1e-6 / TURN
    noise = 0.004 * size * w * np.random.default_rng(seed).standard_normal(len(w))
    lost = (1.0 + further) * LEAKAGE * p + bypass * (p / 4e7) ** 0.6 + noise
    torque = None
    if rubbing is not None:
        scatter = np.random.default_rng([seed, 1]).standard_normal(len(w))
        torque = 0.05 * w + 0.03 * size * p + rubbing + 0.004 * size * p * scatter
    return UnitSamples("pump", size, np.ones(len(w)), w, p, lost, torque, noise=0.004)


def test_sound_against_sound_and_grown_leakage():
    assert diagnose_unit(pump(1), baseline=pump(2)).diagnosis.verdict == "no_gap"
    worn = diagnose_unit(pump(3, further=2.0), baseline=pump(2)).to_dict()
    assert worn["verdict"] in ("cause_found", "ambiguous")
    assert worn["baseline"]["control"]["verdict"] == "no_gap"


@pytest.mark.parametrize(
    "rows", [12, *(pytest.param(n, marks=pytest.mark.long) for n in (24, 48)), 100]
)
def test_a_leak_is_named_with_few_rows_and_with_many(rows):
    """The rest that no form explains is judged against the change, not against the noise alone."""
    leaking = pump(6, levels=10, bypass=1e-4)
    kept = np.sort(np.random.default_rng(rows).permutation(len(leaking))[:rows])
    answer = diagnose_unit(leaking.select(kept), baseline=pump(2, levels=8))
    assert answer.diagnosis.verdict in NAMING and answer.component == "pump"
    assert "Flow loss +" in answer.report()


def test_a_change_of_the_torque_alone_is_named():
    answer = diagnose_unit(pump(1, rubbing=9.0), baseline=pump(2, rubbing=4.0))
    assert answer.diagnosis.verdict in ("cause_found", "ambiguous")
    assert answer.component == "pump"
    assert answer.diagnosis.sets[0].effects == ("constant_torque",)


def test_wrong_baselines_are_named():
    sound = pump(2)
    with pytest.raises(InputError, match="another machine"):
        diagnose_unit(sound, baseline=replace(sound, displacement=1e-5))
    with pytest.raises(InputError, match="too few for a baseline"):
        diagnose_unit(sound, baseline=sound.select(np.arange(9)))


def test_a_zero_of_the_meter_is_no_wear():
    sound = pump(2)
    zero = 2e-4 * sound.meter_reading("flow_loss").max()
    later = replace(pump(4), flow_loss=pump(4).flow_loss + zero)
    assert diagnose_unit(later, baseline=sound).diagnosis.verdict == "no_gap"


def with_drain_and_power(unit, further=0.0, zero=0.0, efficiency=0.90):
    """Add the flow of the drain, with the zero of its meter [m3/s], and the electric power."""
    rng = np.random.default_rng(len(unit))
    drain = 0.9 * (1.0 + further) * LEAKAGE * unit.pressure
    drain = drain * (1.0 + 0.005 * rng.standard_normal(len(unit)))
    shaft = (unit.displacement * unit.pressure + unit.torque_loss) * unit.speed
    power = 300.0 + shaft / efficiency * (1.0 + 0.003 * rng.standard_normal(len(unit)))
    return replace(unit, drain_flow=drain + zero, electric_power=power)


@pytest.mark.long
def test_a_drain_meter_or_a_motor_that_differs_today_is_no_wear():
    sound = with_drain_and_power(pump(2, rubbing=4.0))
    later = with_drain_and_power(pump(4, rubbing=4.0), zero=1e-6, efficiency=0.895)
    assert diagnose_unit(later, baseline=sound).diagnosis.verdict == "no_gap"


@pytest.mark.long
def test_channels_that_are_added_do_not_hide_a_leak():
    sound = with_drain_and_power(pump(2, rubbing=4.0))
    leaking = pump(4, further=1.0, rubbing=4.0)
    leaking = with_drain_and_power(leaking, further=1.0, zero=1e-6, efficiency=0.895)
    diagnosis = diagnose_unit(leaking, baseline=sound).diagnosis
    assert diagnosis.verdict in NAMING
    assert diagnosis.sets[0].effects == ("laminar_leakage",)


@pytest.mark.long
def test_same_seed_same_answer():
    answers = [
        diagnose_unit(pump(3, further=2.0), baseline=pump(2), seed=5).to_dict()
        for _ in range(2)
    ]
    assert answers[0] == answers[1]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a plan can tell apart, and what to measure next."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission
from hmcvt_core.physics.effects.mechanical import ChargePump

from .campaigns import BASE, NOISE, campaign, measure, random_points, with_column


def _matrix(samples, **options):
    return hmcvt.separable(BASE, samples, **{"noise": NOISE, **options})


# More tests reach higher thresholds, whose forms show less than those seen before.
WITH_THRESHOLD = {"relief_valve", "inlet_starvation", "clutch_slip", "fan_drive"}


def _common(*found):
    """Separation of the effects without threshold that all can show, in one order."""
    shown = set.intersection(*(set(item.effects) for item in found))
    names = sorted(shown - WITH_THRESHOLD)
    index = [[item.effects.index(name) for name in names] for item in found]
    return [item.separation[np.ix_(i, i)] for item, i in zip(found, index, strict=True)]


@pytest.mark.parametrize(
    "speed_noise", [0.001, None], ids=["with speed", "efficiency alone"]
)
def test_mimic_lowers_visibility(speed_noise):
    found = _matrix(campaign(seed=1, speed_noise=speed_noise))
    k = len(found.effects)
    assert found.separation.shape == (k, k)
    assert list(found.effects) == sorted(set(found.effects))
    assert (found.separation >= 0.0).all()
    assert (found.separation <= found.detectability[:, None] * (1.0 + 1e-9)).all()
    np.testing.assert_allclose(np.diag(found.separation), found.detectability)
    # Twins cannot be told apart.
    for one, other in (
        ("charge_pump", "torque_sensor"),
        ("charge_pump", "bearing_drag"),
    ):
        i, j = found.effects.index(one), found.effects.index(other)
        assert found.separation[i, j] < 0.02 * found.detectability[i]
        assert other in found.indistinguishable_from(one)
    pump = found.effects.index("charge_pump")
    leakage = found.effects.index("pressure_leakage")
    assert found.separation[pump, leakage] > 0.8 * found.detectability[pump]
    # The zero of a meter in a session hides a part of a charge pump of typical size; what is left
    # is visible.
    assert "pressure_leakage" not in found.indistinguishable_from("charge_pump")


def test_more_data_never_lower_separation():
    samples = measure(random_points(3, 48), noise=0.0)
    # The largest torques come first: the range of a meter, and so its error, follows them.
    engine_torque = samples.load_torque / samples.efficiency
    output_torque = samples.load_torque * samples.engine_speed / samples.output_speed
    relative = np.maximum(
        engine_torque / engine_torque.max(), output_torque / output_torque.max()
    )
    samples = samples.select(np.argsort(-relative))
    found = [
        _matrix(with_column(samples.select(np.arange(12)), output_speed=None)),
        *(_matrix(samples.select(np.arange(n))) for n in (12, 24, 48)),
    ]
    for few, more in pairwise(found):
        before, after = _common(few, more)
        assert (after >= before * (1.0 - 1e-6) - 1e-6).all()
        assert after.sum() > before.sum()


def test_oil_temperature_needs_a_sweep():
    swept = _matrix(campaign(seed=1, n=48, temperature=True))
    assert "oil_temperature" in swept.effects
    assert swept.detectability[swept.effects.index("oil_temperature")] > 9.0
    assert "oil_temperature" not in _matrix(campaign(seed=1, n=48)).effects


def test_plan_of_one_point():
    known = replace(BASE, effects=(ChargePump(6.0),))
    found = hmcvt.separable(known, campaign(seed=1, n=1), noise=NOISE)
    assert np.isfinite(found.separation).all()
    assert "charge_pump" not in found.effects


def test_repeats_of_a_plan_state_no_noise():
    """Filled-in readings agree to the last digit; that is no noise of a bench."""
    points = random_points(1, 12)
    once = hmcvt.BenchSamples(*points[:3], BASE.solution_at(points).efficiency)
    thrice = once.select(np.repeat(np.arange(12), 3))
    single, triple = (hmcvt.separable(BASE, plan) for plan in (once, thrice))
    assert triple.plan.stated_noise == pytest.approx(single.plan.stated_noise)
    assert (triple.detectability >= single.detectability * (1.0 - 1e-9)).all()
    assert (triple.detectability <= 3.0 * single.detectability * (1.0 + 1e-9)).all()


def test_confused_effects_come_with_remedies():
    found = _matrix(campaign(seed=1, speed_noise=None))
    confused = {item["effect"]: item for item in found.to_dict()["confused"]}
    assert "torque_sensor" in confused["charge_pump"]["indistinguishable_from"]
    assert any("meter" in remedy for remedy in confused["charge_pump"]["remedies"])
    flow = confused["pressure_leakage"]
    assert flow["told_by_output_speed"], "reading the output speed helps a flow loss"
    assert set(flow["told_by_output_speed"]) <= set(flow["indistinguishable_from"])
    both = _matrix(campaign(seed=1))
    for name, item in confused.items():
        seen = found.detectability[found.effects.index(name)]
        assert seen >= 9.0
        assert item["told_by_output_speed"] == [
            other
            for other in item["indistinguishable_from"]
            if other not in both.indistinguishable_from(name)
        ]
    visible = np.flatnonzero(found.detectability >= 9.0)
    assert [
        found.effects[i]
        for i in visible
        if found.indistinguishable_from(found.effects[i])
    ] == list(confused)
    text = found.report()
    assert "reading the output speed too distinguishes it from" in text
    assert max(map(len, text.splitlines())) <= 100
    assert not _matrix(campaign(seed=1)).report().count("reading the output speed")


def test_pressure_separates_sides_of_the_motor():
    """A friction of the motor moves the pressure; one of the engine side and a meter do not."""
    full = campaign(seed=1, pressure_noise=1.0)
    some, most = _matrix(with_column(full, pressure=None)), _matrix(full)
    before, after = _common(some, most)
    assert (after >= before * (1.0 - 1e-6) - 1e-6).all()
    assert (after >= 9.0).sum() >= (before >= 9.0).sum() + 15
    gears = next(item for item in some.confused() if item["effect"] == "gear_mesh")
    assert gears["told_by_pressure"] == ["torque_sensor"]
    without_speed = _matrix(with_column(full, output_speed=None))
    assert without_speed.further == "output_speed"
    assert without_speed.fuller.plan.channels[1].name == "output_speed"


def test_advice_for_a_very_lossy_base():
    lossy = replace(BASE, parameters=hmcvt.HydraulicParameters(2e-11, 2.0, 2.5))
    system = Transmission(lossy)
    base = np.array([np.log10(2e-11), 2.0, 2.5, 0.0])
    measured = {
        name: values
        for name, values in random_points(1, 60)._asdict().items()
        if values is not None
    }
    possible = system.candidates(measured, base)
    efficiency = system.predict(base, (), possible)[0]
    assert 0 < len(efficiency) < 9 * 6 * 6
    assert efficiency.min() >= 0.01
    assert possible["engine_speed"].min() == pytest.approx(750.0 * np.pi / 30.0)
    assert (possible["engine_speed"] * possible["load_torque"]).min() >= 4e3 * (
        1.0 - 1e-9
    )

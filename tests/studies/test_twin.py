# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The twin: its physics, its effects and its campaigns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import hmcvt_core as hmcvt
from studies.blind.campaign import fresh, make_campaign
from studies.blind.catalogue import (
    KNOWN_EFFECTS,
    TURNED_EFFECTS,
    UNKNOWN_EFFECTS,
    draw_effect,
    mean_shift,
    size_effect,
)
from studies.blind.plans import random_points, reference_points
from studies.blind.twin import BaseTruth, OperatingPoints, Plant
from studies.blind.visible import visible

BASE = BaseTruth(leakage=2e-11, motor_damping=0.12, pump_damping=0.08)
SWING = 25.0


def drawn(name, seed=5):
    return draw_effect(name, np.random.default_rng(seed))


EVERY_EFFECT = [
    f"{name}:{variant}" if variant else name
    for name in KNOWN_EFFECTS + UNKNOWN_EFFECTS
    for variant in drawn(name).variants or ("",)
]
SENSORS = (
    "displacement_error",
    "torque_sensor",
    "oil_temperature",
)  # these may also gain


def test_no_effect_equals_the_power_balance():
    points = reference_points(SWING)
    read = Plant(BASE).read(points)
    model = hmcvt.EfficiencyModel(
        hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml")),
        hmcvt.HydraulicParameters(*list(vars(BASE).values())[:3]),
    )
    at = points.displacement_ratio, points.engine_speed, points.load_torque
    watts = model.breakdown(*at).losses
    # Nearer than that to standstill of the motor, or to an idle pump, the twin smooths friction.
    motor = np.sqrt(watts["motor_damping"] / BASE.motor_damping)
    away = (motor > 12.0) & (watts["gear_pair_4"] > 0.24 * points.engine_speed / 0.678)
    assert np.mean(away) > 0.7
    for found, expected in (
        (read.efficiency, model.efficiency(*at)),
        (read.output_speed, model.output_speed(*at)),
    ):
        np.testing.assert_allclose(found[away], expected[away], rtol=1e-8)
        np.testing.assert_allclose(found, expected, rtol=2e-3)


@pytest.mark.parametrize("name", ["", *EVERY_EFFECT])
def test_energy_is_balanced_and_every_loss_dissipates(name):
    effects = (replace(drawn(name), size=0.5),) if name else ()
    read = Plant(BASE, effects).read(reference_points(SWING))
    run = read.settled
    assert np.mean(run) > 0.9
    lost = sum(read.losses.values())
    assert lost[run] == pytest.approx(
        (read.input_power - read.output_power)[run], rel=1e-9
    )
    for place, power in read.losses.items():
        assert np.min(power[run]) > -1e-6, place


def test_loading_in_real_time_reaches_the_same_stall():
    """Bring the load up in 4 s and hold it 2 s, by a stiff integrator."""
    effects = (replace(drawn("pressure_friction"), size=2.0), drawn("stroke_leakage"))
    plant = Plant(replace(BASE, leakage=4e-11), effects)
    point = OperatingPoints(
        *(np.array([value]) for value in (-0.98, 138.0, 560.0, 60.0))
    )
    read = plant.read(point)
    assert not read.settled[0] and np.isnan(read.efficiency[0])

    def rates(time, y):
        share = min(1.0, 0.2 + 0.2 * time)
        return plant.rates(
            y[:, None], replace(point, load_torque=share * point.load_torque)
        )[:, 0]

    start = plant.guess(replace(point, load_torque=0.2 * point.load_torque))[:, 0]
    found = solve_ivp(rates, (0.0, 6.0), start, method="BDF", rtol=1e-6, atol=1e-4)
    assert found.y[0, -1] > 45e6


def shift_by(effect, points):
    return (
        Plant(BASE, (effect,)).read(points).efficiency
        - Plant(BASE).read(points).efficiency
    )


@pytest.mark.parametrize("name", EVERY_EFFECT)
def test_shift_reaches_its_target(name):
    swing = SWING if name == "oil_temperature" else 0.0
    target = 0.002 if name.startswith("displacement_error") else 0.01
    moved = shift_by(
        size_effect(BASE, drawn(name), target, swing), reference_points(swing)
    )
    assert mean_shift(moved) == pytest.approx(target, rel=0.006)
    if not name.startswith(SENSORS):
        assert np.nanmean(moved) < 0.0


@pytest.mark.parametrize("name", TURNED_EFFECTS)
def test_a_loss_that_the_base_overstates_turns_the_shift_and_still_leaves_a_loss(name):
    effect = size_effect(BASE, drawn(name), 0.005)
    assert -TURNED_EFFECTS[name] <= effect.size < 0.0
    assert np.nanmean(shift_by(effect, reference_points())) > 0.0
    read = Plant(BASE, (effect,)).read(reference_points(SWING))
    assert np.all(read.losses["flow"] > 0.0)
    assert np.nanmax(read.efficiency) < 1.0


@pytest.mark.parametrize("name", UNKNOWN_EFFECTS)
def test_unknown_effects_keep_to_a_place(name):
    points = random_points(500, np.random.default_rng(1))
    moved = np.abs(shift_by(size_effect(BASE, drawn(name), 0.02), points))
    assert 0.05 < np.mean(moved > 0.005) < 0.5
    assert np.sum(moved[moved > 0.005]) > 0.7 * np.sum(moved)


def test_the_base_is_off_by_a_smooth_field_as_large_as_asked_for():
    for seed in range(3):
        off, exact = make_campaign(seed, misfit=0.0015), make_campaign(seed)
        moved = off.truth["efficiency"] - exact.truth["efficiency"]
        assert np.sqrt(np.mean(moved**2)) == pytest.approx(0.0015, rel=0.3)
        assert moved.max() > 0.0005 and moved.min() < -0.0005
        slowed = off.truth["output_speed"] / exact.truth["output_speed"] - 1.0
        assert np.std(slowed) < 0.001


def test_what_is_visible_is_what_a_refit_leaves():
    """Against a nonlinear refit of the plant itself, and a twin of an effect already there."""
    campaign = make_campaign(3, [("output_churning", 0.015)])
    points = OperatingPoints(
        *(
            campaign.samples[name]
            for name in ("displacement_ratio", "engine_speed", "load_torque")
        ),
        campaign.truth["oil_temperature"],
    )
    base, truth = campaign.bench.base, campaign.truth

    def left(factors):
        names = ("leakage", "motor_damping", "pump_damping")
        read = Plant(
            replace(
                base,
                **{
                    name: factor * getattr(base, name)
                    for name, factor in zip(names, factors[:3], strict=True)
                },
            )
        ).read(points)
        return np.concatenate(
            [
                (truth["efficiency"] / (1.0 + 0.0015 * factors[3]) - read.efficiency)
                / 0.004,
                (truth["output_speed"] / read.output_speed - 1.0) / 0.001,
                factors[3:],
            ]
        )

    by_refit = 2.0 * least_squares(left, [1.0, 1.0, 1.0, 0.0]).cost
    assert visible(campaign).left[0] == pytest.approx(by_refit, rel=0.2)
    twins = visible(
        make_campaign(3, [("bearing_drag", 0.01), ("torque_sensor:engine_zero", 0.01)])
    )
    assert twins.alike > 0.9
    assert max(twins.left) < 18.0
    assert visible(make_campaign(3)).left == ()


def test_viscosity_moves_leakage_and_damping_only_as_the_effect_oil_temperature():
    warm = np.array([35.0, 85.0])
    points = OperatingPoints(
        np.full(2, 0.9), np.full(2, 150.0), np.full(2, 300.0), warm
    )
    plain = Plant(BASE).read(points)
    assert plain.efficiency[0] == plain.efficiency[1]
    hot = Plant(BASE, (drawn("oil_temperature"),)).read(points)
    assert hot.losses["flow"][1] > 1.5 * hot.losses["flow"][0]
    assert hot.losses["pump friction"][1] < 0.7 * hot.losses["pump friction"][0]


def same(one, other):
    return np.array_equal(one.samples["efficiency"], other.samples["efficiency"])


def test_seeds_reproduce_and_a_fresh_campaign_keeps_the_plant():
    wanted = [("charge_pump", 0.01), ("gear_mesh", 0.008)]
    first = make_campaign(11, wanted, samples=40)
    assert same(first, make_campaign(11, wanted, samples=40))
    assert not same(first, make_campaign(12, wanted, samples=40))
    again = fresh(first, 99)
    assert same(again, fresh(first, 99))
    assert again.bench == first.bench
    assert not same(again, first)


def test_noise_is_what_the_options_say():
    plain = make_campaign(
        3, samples=400, stated_noise_factor=None, output_speed_noise=None
    )
    assert len(plain.samples) == 4
    error = plain.samples["efficiency"] - plain.truth["efficiency"]
    assert np.std(error) == pytest.approx(0.004, rel=0.15)
    odd = make_campaign(3, samples=400, stated_noise_factor=0.5)
    assert np.all(odd.samples["efficiency_std"] == 0.002)
    speed = odd.samples["output_speed"] / odd.truth["output_speed"] - 1.0
    assert np.std(speed) == pytest.approx(0.001, rel=0.15)

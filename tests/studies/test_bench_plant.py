# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The bench: its physics, its meters, and that every property is switched off by itself."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from studies.blind.bench.campaign import make_campaign
from studies.blind.bench.judge import served
from studies.blind.bench.layouts import LAYOUTS, Machine
from studies.blind.bench.listed_losses import LISTED_LOSSES
from studies.blind.bench.plant import Settings
from studies.blind.bench.programme import draw_programme
from studies.blind.bench.properties import PROPERTIES, Bench
from studies.blind.bench.truth import KINDS, draw_hidden
from studies.blind.bench.unlisted_losses import UNLISTED_LOSSES
from studies.blind.catalogue import KNOWN_EFFECTS

ALL_OFF = Bench(**dict.fromkeys(PROPERTIES, False))


def settings_for(layout, tests=60, seed=3):
    rng = np.random.default_rng(seed)
    programme = draw_programme(Bench(), list(layout.ranges), tests, rng, rng)
    warm = np.full(tests, 60.0)
    return programme, Settings(
        programme.displacement_ratio,
        programme.engine_speed,
        programme.load_torque,
        warm,
        warm,
        np.ones(tests),
    )


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_the_plain_machine_equals_the_served_model(layout):
    programme, settings = settings_for(layout)
    state = Machine(layout, layout.base).run(settings, programme.stage)
    model = hmcvt.load_model(hmcvt.data_path(layout.model_file))
    for number, train in enumerate(layout.trains):
        index = (programme.stage == number) & state.runs
        stage = model.stages[train.name]
        at = [
            values[index]
            for values in (
                settings.displacement_ratio,
                settings.engine_speed,
                settings.load_torque,
            )
        ]
        efficiency = state.efficiency(settings.engine_speed)[index]
        np.testing.assert_allclose(efficiency, stage.efficiency(*at), atol=1e-6)
        speed = state.output_speed[index]
        np.testing.assert_allclose(speed, stage.output_speed(*at), rtol=1e-6)
    assert np.mean(state.runs) > 0.9


def test_readings_are_exact_with_every_property_off():
    campaign = make_campaign("nothing", 5, ALL_OFF, tests=40)
    model, samples = served(campaign)
    base = campaign.truth.plain.base
    model = hmcvt.EfficiencyModel(
        model.stage,
        hmcvt.HydraulicParameters(base.leakage, base.motor_damping, base.pump_damping),
    )
    at = samples.displacement_ratio, samples.engine_speed, samples.load_torque
    np.testing.assert_allclose(samples.efficiency, model.efficiency(*at), atol=1e-6)
    np.testing.assert_allclose(samples.output_speed, model.output_speed(*at), rtol=1e-6)


@pytest.mark.parametrize("name", PROPERTIES)
def test_each_property_changes_something_alone(name):
    kind = "base_off" if name == "texture" else "nothing"
    for seed in range(8):
        whole = make_campaign(kind, seed, Bench(), tests=24)
        part = make_campaign(kind, seed, Bench().without(name), tests=24)
        if readings_differ(whole, part):
            return
    pytest.fail(f"{name} changes nothing")


def readings_differ(one, other):
    if set(one.columns) != set(other.columns) or one.texts != other.texts:
        return True
    if not np.array_equal(one.settings.oil_temperature, other.settings.oil_temperature):
        return True
    return any(
        not np.array_equal(one.columns[name], other.columns[name])
        for name in one.columns
    )


def test_a_session_shares_its_zero_and_its_gain():
    bench = replace(ALL_OFF, sessions=True, zero=True, order=True)
    campaign = make_campaign("nothing", 2, bench, tests=60)
    session = campaign.programme.session
    power = campaign.state.output_torque * campaign.state.output_speed
    shown = campaign.columns["load_torque"] * campaign.settings.engine_speed
    zeros = (shown - power) / campaign.state.output_speed
    for number in np.unique(session):
        assert np.ptp(zeros[session == number]) < 1e-9
    assert np.ptp(zeros) > 1e-3
    gaps = np.diff(campaign.programme.stamp)[np.diff(session) > 0]
    assert 1 <= len(gaps) <= 5
    assert np.min(gaps) > 3600.0


def test_oil_warms_with_what_is_lost():
    campaign = make_campaign("nothing", 7, Bench(), tests=60)
    oil = campaign.settings.oil_temperature
    first = np.diff(campaign.programme.session, prepend=-1) > 0
    assert np.mean(oil[first]) < np.mean(oil[~first])
    assert np.min(oil) > 25.0 and np.max(oil) < 110.0
    assert np.all(campaign.settings.film_temperature > oil)


@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[pytest.mark.long] * (kind in ("triple", "pair")))
        for kind in KINDS
    ],
)
def test_equal_seeds_give_equal_readings(kind):
    one = make_campaign(kind, 11, Bench(), tests=16)
    other = make_campaign(kind, 11, Bench(), tests=16)
    for name, values in one.columns.items():
        np.testing.assert_array_equal(values, other.columns[name])


@pytest.mark.parametrize("name", UNLISTED_LOSSES)
def test_an_unlisted_loss_takes_power(name):
    layout = LAYOUTS[0]
    programme, settings = settings_for(layout)
    effect = UNLISTED_LOSSES[name]().drawn(np.random.default_rng(1))
    plain = Machine(layout, layout.base)
    with_loss = replace(plain, effects=(effect,)).run(settings, programme.stage)
    before = plain.run(settings, programme.stage).efficiency(settings.engine_speed)
    moved = with_loss.efficiency(settings.engine_speed) - before
    assert np.nanmin(moved) < -1e-4


def test_a_pair_hides_two_effects():
    rng = np.random.default_rng(4)
    assert len(draw_hidden("pair", rng)) == 2
    assert draw_hidden("nothing", rng) == []


@pytest.mark.parametrize("name", LISTED_LOSSES)
def test_a_listed_loss_has_the_name_of_an_effect_and_moves_the_readings(name):
    assert name in KNOWN_EFFECTS
    layout = LAYOUTS[0]
    programme, settings = settings_for(layout)
    settings = replace(settings, oil_temperature=np.linspace(40.0, 80.0, 60))
    effect = LISTED_LOSSES[name]().drawn(np.random.default_rng(1))
    plain = Machine(layout, layout.base)
    state = replace(plain, effects=(effect,)).run(settings, programme.stage)
    engine, output = effect.read(state.engine_torque, state.output_torque)
    ratio = output * state.output_speed / (engine * settings.engine_speed)
    before = plain.run(settings, programme.stage).efficiency(settings.engine_speed)
    assert np.nanmax(np.abs(ratio - before)) > 1e-4

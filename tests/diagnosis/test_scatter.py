# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Noise above its statement, and a loss that scatters because its cause is not recorded."""

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.diagnosis.selection.explanation import explain, scattered
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_core.physics.effects.mechanical import ChargePump

from .campaigns import BASE, NOISE, campaign, fitted, measure, random_points


def _with_a_pump(stated, noise=NOISE):
    samples = campaign((ChargePump(20.0),), seed=4, noise=noise)
    return hmcvt.diagnose(BASE, samples, noise=stated)


def test_a_set_that_leaves_far_more_than_the_stated_noise_is_not_all_of_it():
    as_stated = _with_a_pump(NOISE)
    above = _with_a_pump(NOISE / 4.0)
    assert as_stated.unlisted < 0.1
    assert above.unlisted > 0.5
    assert above.verdict == "ambiguous"
    assert above.sets[0].effects == ("charge_pump",)
    assert "not recorded" in above.scatter.sentence
    assert as_stated.scatter is None


@pytest.mark.long
@pytest.mark.parametrize("part", [0.3, 0.8, 1.25])
def test_noise_near_or_below_its_statement_blames_nothing(part):
    assert _with_a_pump(NOISE / part).unlisted < 0.1


def _log_odds_of_scatter(samples, noise):
    """Of a loss that scatters against a noise that is understated; None where none is stated."""
    observed = fitted(samples, noise).observed
    hypothesis = Hypothesis(Transmission(BASE), (ChargePump(20.0),))
    explanation = explain(refit(hypothesis, observed))
    for extended in scattered(explanation):
        assert extended.explained_fraction(explanation) < 0.05
        return extended.log_evidence - explanation.log_evidence
    return None


@pytest.mark.parametrize("n", [10, 96])
def test_noise_that_nobody_stated_blames_nothing(n):
    samples = campaign((ChargePump(20.0),), seed=3, n=n, noise=4.0 * NOISE)
    assert _log_odds_of_scatter(samples, None) is None
    assert _log_odds_of_scatter(samples, NOISE) is not None


def test_odds_grow_with_the_noise_and_are_finite():
    samples = campaign((ChargePump(20.0),), seed=3, noise=NOISE)
    odds = []
    for part in (1.0, 2.0, 4.0, 1000.0):
        odds.append(_log_odds_of_scatter(samples, NOISE / part))
    assert odds[0] < -1.0
    assert np.isfinite(odds).all()
    assert (np.diff(odds) > 0.0).all()


@pytest.mark.long
def test_many_repeats_do_not_hide_every_set():
    points = random_points(5, n=40)
    repeated = points.map(lambda row: np.repeat(row, 8))

    def by_point(at):
        return np.repeat(np.random.default_rng(9).uniform(0.0, 0.12, 40), 8)

    found = hmcvt.diagnose(BASE, measure(repeated, loss=by_point))
    assert found.unlisted > 0.5 or found.verdict == "no_gap"


def test_a_loss_by_an_unrecorded_temperature_is_noted():
    """A fan that a thermostat turns on while the campaign has no oil temperature."""
    rng = np.random.default_rng(5)

    def fan(points):
        is_on = rng.uniform(size=points.engine_speed.shape) < 0.7
        return (
            0.05
            * is_on
            * (points.engine_speed / 150.0) ** 2
            * 200.0
            / points.load_torque
        )

    found = hmcvt.diagnose(BASE, campaign(seed=4, loss=fan), noise=NOISE)
    assert found.verdict == "excess_scatter", "no axis shows it"
    assert found.agreement.ratio > 1.5
    assert "not recorded" in found.scatter.sentence


@pytest.mark.long
def test_films_warmer_than_the_tank_are_no_further_cause():
    """Damping that falls where much is lost: films follow the loss, a column only the tank."""

    class WarmFilms(OilTemperature):
        def pump_drag(self, state):
            rise = 30.0 * state.load_power / 5e4
            softer = np.exp(-0.04 * self.strength * rise) - 1.0
            film = self.film_viscosity_ratio(state.oil_temperature)
            return BASE.parameters.pump_damping * film * softer * state.pump_speed

    samples = campaign((WarmFilms(1.0),), seed=6, temperature=True)
    found = hmcvt.diagnose(BASE, samples, noise=NOISE)
    assert found.sets[0].effects == ("oil_temperature",)

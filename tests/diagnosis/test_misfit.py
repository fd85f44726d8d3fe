# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Models of a diagnosis state what they miss."""

from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt

from .campaigns import BASE, campaign, diagnosed

NOISE = 0.004


def wave(points):
    """A loss that no listed effect makes."""
    by_speed = np.cos((points.engine_speed - 80.0) / 50.0)
    return 0.02 * np.sin(3.0 * points.displacement_ratio) * by_speed


@pytest.fixture(scope="module")
def unexplained():
    return hmcvt.diagnose(BASE, campaign(seed=1, noise=NOISE, loss=wave), noise=NOISE)


@pytest.fixture(scope="module")
def fresh():
    return campaign(seed=2, n=300, noise=0.0, loss=wave)


def error(model, tests):
    """Root mean square error."""
    predicted = model.efficiency(*tests.points[:3])
    return float(np.sqrt(np.nanmean((predicted - tests.efficiency) ** 2)))


def coverage(model, tests):
    """Fraction of tests that lie in the 95 % intervals."""
    prediction = model.predict(*tests.points[:3])
    off = np.abs(prediction.efficiency - tests.efficiency)
    return np.mean(off <= 1.96 * prediction.standard_error)


def test_base_states_the_gap(unexplained, fresh):
    assert unexplained.base.misfit == pytest.approx(
        error(unexplained.base, fresh), rel=0.25
    )
    assert coverage(unexplained.base, fresh) > 0.9
    assert coverage(replace(unexplained.base, misfit=0.0), fresh) < 0.6


def test_remainder_states_what_it_leaves(unexplained, fresh):
    model = unexplained.model
    assert 0.0 < model.misfit < 0.7 * unexplained.base.misfit
    assert coverage(model, fresh) > 0.85


def test_cause_leaves_less_than_the_base():
    diagnosis = diagnosed("planetary mesh")
    assert diagnosis.verdict in ("cause_found", "ambiguous")
    assert diagnosis.model.misfit < 0.3 * diagnosis.base.misfit


def test_misfit_of_the_model_given_is_not_inherited():
    given = replace(BASE, misfit=0.1)
    diagnosis = hmcvt.diagnose(given, campaign(seed=3, noise=NOISE), noise=NOISE)
    assert diagnosis.model.misfit < 0.5 * NOISE


def test_change_inherits_the_misfit_of_the_sound_model():
    sound = campaign(seed=1000, n=48, noise=NOISE, loss=wave)
    change = hmcvt.diagnose(
        BASE, campaign(seed=1, n=24, noise=NOISE, loss=wave), baseline=sound
    )
    assert change.base.misfit > 0.5 * error(
        change.base, campaign(seed=2, n=300, noise=0.0, loss=wave)
    )

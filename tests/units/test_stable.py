# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Inputs changed by their last digits change no figure of a fitted unit."""

from dataclasses import replace

import numpy as np
import pytest

from hmcvt_core.benches.baseline.remainder import _matern_with_slopes, matern
from hmcvt_core.benches.unit import diagnose_unit
from hmcvt_core.benches.unit.sound import fit_sound_unit
from studies.stability import differences

from .test_served import pump


def _rounded(samples, seed):
    """Return samples whose readings are changed by 1e-8 relative."""
    rng = np.random.default_rng(seed)
    factors = 1.0 + 1e-8 * rng.standard_normal((4, len(samples)))
    return replace(
        samples,
        flow_loss=samples.flow_loss * factors[0],
        torque_loss=samples.torque_loss * factors[1],
        speed=samples.speed * factors[2],
        pressure=samples.pressure * factors[3],
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_last_digits_change_no_prediction(seed):
    samples, beyond = pump(seed, bump=4e-5).divided("pressure", 0.7)
    points = {
        "displacement_ratio": beyond.displacement_ratio,
        "speed": beyond.speed,
        "pressure": beyond.pressure,
    }
    channels = ["flow_loss", "torque_loss"]
    predicted = []
    for table in (samples, _rounded(samples, 1), _rounded(samples, 2)):
        mean, _ = fit_sound_unit(table, channels, ()).sound_at(points)
        predicted.append(mean)
    scale = np.sqrt(np.mean(predicted[0] ** 2, axis=1, keepdims=True))
    for other in predicted[1:]:
        assert np.abs((other - predicted[0]) / scale).max() < 1e-3


@pytest.mark.long
@pytest.mark.parametrize(
    ("squeezed", "axis"),
    [(0.0, "speed"), (1.5, "pressure")],
)
def test_last_digits_change_no_figure(squeezed, axis):
    samples, beyond = pump(7, squeezed, bump=2e-5).divided(axis, 0.7)
    first = diagnose_unit(samples, beyond, deals=False)
    second = diagnose_unit(_rounded(samples, 1), beyond, deals=False)
    assert list(differences(first.to_dict(), second.to_dict())) == []


def test_slopes_of_the_kernel_are_its_derivatives():
    points = np.random.default_rng(0).uniform(size=(6, 2))
    lengths = np.array([0.4, 1.3])
    step = 1e-6
    squares = np.moveaxis((points[:, None] - points) ** 2, -1, 0)
    correlation, slopes = _matern_with_slopes(squares, lengths)
    assert correlation == pytest.approx(matern(points, points, lengths), abs=1e-14)
    for i, slope in enumerate(slopes):
        factor = np.ones(2)
        factor[i] = np.exp(step)
        above = matern(points, points, lengths * factor)
        below = matern(points, points, lengths / factor)
        assert slope == pytest.approx((above - below) / (2.0 * step), abs=1e-8)

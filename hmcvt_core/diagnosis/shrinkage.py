# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""How far the gap shrinks, on data not used for the fit.

.. math:: G^2 = \overline{e^2} - \sigma^2, \qquad S = 1 - G^2_{after} / G^2_{before}

e are errors of prediction of the first channel at samples left out, sigma is the noise. Base
parameters are refitted on both sides in every fold, and the effect is *chosen* inside the fold:
choosing it on all samples first would promise too much. How the samples are dealt to the folds is
chance; errors are averaged over several deals, so that the figure hardly moves with the seed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .evidence import evidence, gram
from .observations import Observations, replicate_groups
from .result import ShrinkageSummary
from .rivals import Linear
from .system import Array

FOLDS = 12
DEALS = 8
_DRAWS = 999
_TAIL = 0.025


def deals(observed: Observations, seed: int) -> list[list[NDArray[np.intp]]]:
    """Deal the samples to folds several times; once where every point is left out alone.

    Each fold is the part left out; repeated points stay together.
    """
    group = replicate_groups(observed.axes, observed.points)
    points = int(group.max()) + 1
    orders = [np.random.default_rng(seed + 1000 * i).permutation(points)
              for i in range(1 if points <= FOLDS else DEALS)]
    return [[np.flatnonzero(np.isin(group, part))
             for part in np.array_split(order, min(FOLDS, points))] for order in orders]


def cross_validated_errors(
    rivals: Sequence[Linear], observed: Observations, dealt: Sequence[Sequence[NDArray[np.intp]]]
) -> Array:
    """Errors of the first channel at samples left out, (n,); the rival is chosen on the others.

    Over several deals the root of the mean square at each sample, with the sign of the mean:
    squares add up right.
    """
    n, errors = len(observed), np.empty((len(dealt), len(observed)))
    for parts, own in zip(dealt, errors, strict=True):
        best, count = np.full(len(parts), -np.inf), np.array([[n - len(part)] for part in parts])
        for rival in rivals:
            left_out = np.stack([gram(rival.columns[:, part], rival.target[:, part])
                                 for part in parts])
            found = evidence(gram(rival.columns, rival.target) - left_out, count, rival.spread,
                             observed.trust, rival.signs)
            for i in np.flatnonzero(found.log > best).tolist():
                best[i], part, mean = found.log[i], parts[i], found.mean[i]
                for size in np.flatnonzero(rival.signs * mean < 0.0):
                    # The others as they are once it is known to be zero.
                    along = found.covariance[i, :, size]
                    mean = mean - along * mean[size] / along[size]
                own[part] = rival.target[0, part] - rival.columns[0, part] @ mean
    errors *= observed.deviation[0]
    return np.asarray(np.copysign(np.sqrt(np.mean(errors**2, axis=0)), errors.mean(axis=0)))


def shrinkage(
    before: Array, after: Array, noise: Array, on: str, seed: int, real: bool = True
) -> ShrinkageSummary:
    """Compare two sets of prediction errors at the same points.

    Args:
        before, after: errors of the first channel, shape (n,).
        noise: standard deviation of the first channel at each, shape (n,) or scalar.
        on: where the errors come from.
        seed: of the bootstrap over points.
        real: whether there is a gap at all; without one `fraction` is None.
    """
    squares = np.stack([before**2, after**2], axis=1) - np.broadcast_to(
        np.square(noise), before.shape)[:, None]
    mean = squares.mean(axis=0)
    fraction, interval = None, None
    if real and mean[0] > 0.0:
        rng, n = np.random.default_rng(seed), len(squares)
        drawn = np.stack([mean, *(squares[rng.integers(0, n, n)].mean(axis=0)
                                  for _ in range(_DRAWS))])
        drawn = drawn[drawn[:, 0] > 0.0]
        # Below the noise nothing is left to remove; a gap cannot shrink by more than all of it.
        fraction, *others = np.clip(1.0 - drawn[:, 1] / drawn[:, 0], -10.0, 1.0).tolist()
        if others:
            low, high = np.quantile(others, [_TAIL, 1.0 - _TAIL]).tolist()
            interval = low, high
    gap = np.sqrt(np.maximum(mean, 0.0)).tolist()
    return ShrinkageSummary(gap[0], gap[1], fraction, interval, on)

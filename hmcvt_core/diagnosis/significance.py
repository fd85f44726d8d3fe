# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Is there a gap, and where: the largest of many statistics against its own null distribution.

Whoever looks at thousands of regions and dozens of effects finds something. The statistic is
therefore the maximum over everything looked at, and its distribution without a gap comes from
simulated campaigns put through the same refit (max-T; Westfall & Young 1993). Noise is estimated
from the residuals in each of them, as it is in the real one, so that noise stated wrongly does not
raise alarms.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit
from .observations import FEW
from .regions import Regions

Array = NDArray[np.float64]
REPLICATES = 999
_CHUNK = 64


class Significance(NamedTuple):
    """Outcome of the search for a gap.

    Attributes:
        p_value: of the largest statistic over regions and effects together.
        region_channel: the one in which the mean residual of each region, studentised, is largest,
            shape (boxes,).
        region_p: family-wise p value of each region, shape (boxes,).
    """

    p_value: float
    region_channel: NDArray[np.intp]
    region_p: Array


def significance(
    fit: Fit, boxes: Regions, seed: int, replicates: int = REPLICATES
) -> Significance:
    """Test whether anything is left after a refit, anywhere or of any known shape.

    Args:
        fit: the refit without any effect.
        boxes: regions to look at, in each channel.
        seed: of the simulated campaigns.
        replicates: simulated campaigns.
    """
    observed, search = fit.observed, _Search(fit, boxes)
    p, white = len(fit.theta), fit.target / np.sqrt(fit.noise)[:, None]
    *own, effects = search.statistics(white[None], np.zeros((1, p)))
    z = np.concatenate(own)  # of boxes by channel
    rng = np.random.default_rng(seed)
    tops = []
    for start in range(0, replicates, _CHUNK):
        count = min(_CHUNK, replicates - start)
        data = rng.standard_normal((count, *white.shape))
        tops.append(_tops(search.statistics(data, rng.standard_normal((count, p)))))
    null = np.concatenate(tops, axis=1)
    # Two families of looks: the smaller p value, itself judged against the same campaigns.
    ranks = np.min([_p_values(top, top) for top in null], axis=0)
    p_own = np.min([_p_values(top, one) for top, one in zip(
        null, _tops([*own, effects]), strict=True)])
    p_value = (1.0 + np.sum(ranks <= p_own)) / (1.0 + replicates)
    if len(observed) < FEW:
        # Two looks: shape and size.
        p_value = min(1.0, 2.0 * min(p_value, _lack_of_fit(search, white)))
    return Significance(float(p_value), np.abs(z).argmax(axis=0),
                        _p_values(null[0], np.abs(z).max(axis=0)))


class _Search:
    """What is looked at: boxes in each channel, and effects in all of them."""

    def __init__(self, fit: Fit, boxes: Regions) -> None:
        observed, root, n = fit.observed, np.sqrt(fit.noise), len(fit.observed)
        self.fit, self.root, self.trust = fit, root, observed.trusts
        # Which readings, one channel after another, and how they change.
        looks = [(slice(i * n, (i + 1) * n),
                  (boxes.members * reading.unit_loss / root[i]).astype(np.float32))
                 for i, reading in enumerate(observed.readings)]
        effects = np.stack([change for _, change in fit.signatures]) / root[:, None]
        looks.append((slice(effects[0].size), effects.reshape(len(effects), -1)))
        self.looks = [(own, look, _norms(np.sum(look**2, axis=1), look @ fit.absorbed[own]))
                      for own, look in looks]
        # Degrees of freedom by channel.
        used = np.sum(fit.absorbed[:root.size * n].reshape(root.size, -1) ** 2, axis=1)
        self.free = np.maximum(n - used, 1.0)

    def statistics(self, data: Array, prior: Array) -> list[Array]:
        """z of boxes, channel by channel, and of effects, for k campaigns.

        `data` has shape (k, channels, n), `prior` (k, p); each answer (k, looks).
        """
        left = self.fit.left(data, prior)[:, :data[0].size].reshape(data.shape)
        scale = np.sqrt((self.trust + np.sum(left**2, axis=2)) / (self.trust + self.free))
        flat = (left / scale[..., None]).reshape(len(data), -1)
        return [np.asarray(flat[:, own].astype(look.dtype) @ look.T / norms, dtype=float)
                for own, look, norms in self.looks]


def _lack_of_fit(search: _Search, white: Array) -> float:
    """Chance of so much scatter at the noise stated (F test, worth of the statement counted)."""
    from scipy.special import fdtrc

    left = search.fit.left(white[None])[0, :white.shape[1]] * search.root[0]
    free = float(search.free[0])
    return float(fdtrc(free, search.trust[0], np.sum(left**2) / free))


def _norms(squares: NDArray[Any], shadow: NDArray[Any]) -> Array:
    total = squares.astype(np.float64)
    left = total - np.sum(shadow.astype(np.float64) ** 2, axis=1)
    # A column that the refit absorbs whole can show nothing.
    return np.asarray(np.sqrt(np.where(left > 1e-6 * total, left, np.inf)), dtype=np.float64)


def _tops(families: Sequence[Array]) -> Array:
    """Largest |z| of all boxes and of all effects, shape (2, k)."""
    *boxes, effects = (np.abs(z).max(axis=1, initial=0.0) for z in families)
    return np.stack([np.max(boxes, axis=0), effects])


def _p_values(null: Array, values: Array) -> Array:
    above = len(null) - np.searchsorted(np.sort(null), values, side="left")
    return np.asarray((1.0 + above) / (1.0 + len(null)), dtype=np.float64)

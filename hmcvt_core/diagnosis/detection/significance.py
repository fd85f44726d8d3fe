# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Is there a gap, and where: boxes over the samples, each looked at, and what that costs.

Whoever looks at thousands of regions and dozens of effects finds something. The statistic is
therefore the maximum over everything looked at, and its distribution without a gap comes from
simulated campaigns put through the same refit (max-T; Westfall & Young 1993). Noise is estimated
from the residuals in each of them, as it is in the real one, so that noise stated wrongly does not
raise alarms.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.refit import Fit
from ..settings import ABSORBED_PART, NULL_BATCH, NULL_CAMPAIGNS, SMALL_CAMPAIGN
from ..system import Array
from .regions import Regions


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
    fit: Fit, boxes: Regions, seed: int, replicates: int = NULL_CAMPAIGNS
) -> Significance:
    """Test whether anything is left after a refit, anywhere or of any known shape.

    Args:
        fit: the refit without any effect.
        boxes: regions to look at, in each channel.
        seed: of the simulated campaigns.
        replicates: simulated campaigns.
    """
    look, p = _Search(fit, boxes), len(fit.theta)
    white = fit.target / np.sqrt(fit.noise)[:, None]
    found, effects = look(white[None], np.zeros((1, p)))
    rng, tops = np.random.default_rng(seed), []
    for start in range(0, replicates, NULL_BATCH):
        count = min(NULL_BATCH, replicates - start)
        data = rng.standard_normal((count, *white.shape))
        tops.append(_tops(*look(data, rng.standard_normal((count, p)))))
    null = np.concatenate(tops, axis=1)
    # Two families of looks: the smaller p value, itself judged against the same campaigns.
    ranks = np.min([_p_values(top, top) for top in null], axis=0)
    own = np.min(
        [_p_values(*each) for each in zip(null, _tops(found, effects), strict=True)],
        axis=0,
    )
    p_value = (1.0 + np.sum(ranks <= own)) / (1.0 + replicates)
    if len(fit.observed) < SMALL_CAMPAIGN:
        # Two looks: shape and size.
        p_value = min(1.0, 2.0 * min(p_value, look.lack_of_fit(white)))
    return Significance(
        float(p_value),
        found[0].argmax(axis=0),
        _p_values(null[0], found[0].max(axis=0)),
    )


class _Search:
    """What is looked at: boxes in each channel, and effects in all of them."""

    def __init__(self, fit: Fit, boxes: Regions) -> None:
        observed, self.fit, self.root = fit.observed, fit, np.sqrt(fit.noise)
        n, self.prior_dof = len(observed), observed.prior_dof
        # Which readings, one channel after another, and how they change; each channel by itself,
        # that none has to be right for another to show a gap.
        looks = [
            (slice(i * n, (i + 1) * n), (boxes.members * loss).astype(np.float32))
            for i, loss in enumerate(
                np.einsum("iin->in", observed.unit_discrepancy) / self.root[:, None]
            )
        ]
        effects = (
            np.stack([change for _, change in fit.signatures]) / self.root[:, None]
        )
        looks.append((slice(effects[0].size), effects.reshape(len(effects), -1)))
        self.looks = [
            (own, look, _norms(np.sum(look**2, axis=1), look @ fit.nuisance_basis[own]))
            for own, look in looks
        ]
        # Degrees of freedom by channel.
        used = np.sum(
            fit.nuisance_basis[: self.root.size * n].reshape(self.root.size, -1) ** 2,
            axis=1,
        )
        self.free = np.maximum(n - used, 1.0)

    def __call__(self, data: Array, prior: Array) -> tuple[Array, Array]:
        """Return |z| of boxes, (k, channels, boxes), and of effects, (k, effects).

        Of k campaigns, `data` of shape (k, channels, n) and `prior` (k, p).
        """
        left = self.fit.project_out(data, prior)[:, : data[0].size].reshape(data.shape)
        scale = np.sqrt(
            (self.prior_dof + np.sum(left**2, axis=2)) / (self.prior_dof + self.free)
        )
        flat = (left / scale[..., None]).reshape(len(data), -1)
        *boxes, effects = (
            np.abs(flat[:, own].astype(look.dtype) @ look.T / norms)
            for own, look, norms in self.looks
        )
        return np.stack(boxes, axis=1), effects

    def lack_of_fit(self, white: Array) -> float:
        """Chance of so much scatter at the noise stated (F test, its worth counted)."""
        from scipy.special import fdtrc

        left = self.fit.project_out(white[None])[0, : white.shape[1]] * self.root[0]
        free = float(self.free[0])
        return float(fdtrc(free, self.prior_dof[0], np.sum(left**2) / free))


def _norms(squares: NDArray[Any], shadow: NDArray[Any]) -> Array:
    total = squares.astype(np.float64)
    left = total - np.sum(shadow.astype(np.float64) ** 2, axis=1)
    # A column that the refit absorbs whole can show nothing.
    return np.asarray(
        np.sqrt(np.where(left > ABSORBED_PART * total, left, np.inf)), dtype=np.float64
    )


def _tops(boxes: Array, effects: Array) -> Array:
    """Largest |z| of all boxes and of all effects, shape (2, k)."""
    return np.stack(
        [boxes.max(axis=(1, 2), initial=0.0), effects.max(axis=1, initial=0.0)]
    )


def _p_values(null: Array, values: Array) -> Array:
    above = len(null) - np.searchsorted(np.sort(null), values, side="left")
    return np.asarray((1.0 + above) / (1.0 + len(null)), dtype=np.float64)

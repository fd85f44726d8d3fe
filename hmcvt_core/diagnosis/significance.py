# SPDX-License-Identifier: Apache-2.0
"""Is there a gap, and where: the largest of many statistics against its own null distribution.

Whoever looks at thousands of regions and dozens of effects finds something. The statistic is
therefore the maximum over everything looked at, and its distribution without a gap comes from
simulated campaigns put through the same refit (max-T; Westfall & Young 1993). Noise is estimated
from the residuals in each of them, as it is in the real one, so that noise stated wrongly does not
raise alarms.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit
from .observations import FEW
from .ranking import screen
from .regions import Regions

Array = NDArray[np.float64]
REPLICATES = 999
_CHUNK = 64


class Significance(NamedTuple):
    """Outcome of the search for a gap.

    Attributes:
        p_value: of the largest statistic over regions and effects together.
        region_z: studentised mean residual of each region in the channel where it is largest,
            shape (boxes,).
        region_channel: that channel, shape (boxes,).
        region_p: family-wise p value of each region, shape (boxes,).
    """

    p_value: float
    region_z: Array
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
    white = fit.target / np.sqrt(fit.noise)[:, None]
    z_boxes, z_effects = search.statistics(white[None], np.zeros((1, len(fit.theta))))
    rng = np.random.default_rng(seed)
    tops = []
    for start in range(0, replicates, _CHUNK):
        count = min(_CHUNK, replicates - start)
        data = rng.standard_normal((count, *white.shape))
        prior = rng.standard_normal((count, len(fit.theta)))
        tops.append([_top(z) for z in search.statistics(data, prior)])
    null = np.concatenate(tops, axis=1)
    # Two families of looks: the smaller p value, itself judged against the same campaigns.
    ranks = np.min([_p_values(top, top) for top in null], axis=0)
    p_own = np.min([_p_values(top, _top(z)) for top, z in zip(null, (z_boxes, z_effects),
                                                              strict=True)])
    p_value = (1.0 + np.sum(ranks <= p_own)) / (1.0 + replicates)
    if len(observed) < FEW:
        # Two looks: shape and size.
        p_value = min(1.0, 2.0 * min(p_value, _lack_of_fit(search, white)))
    z_channels = z_boxes[0].reshape(len(observed.readings), len(boxes))
    channel = np.abs(z_channels).argmax(axis=0)
    z = np.take_along_axis(z_channels, channel[None], 0)[0]
    return Significance(float(p_value), z, channel, _p_values(null[0], np.abs(z)))


class _Search:
    """What is looked at, and what the refit may absorb of it (`Fit.absorbed`)."""

    def __init__(self, fit: Fit, boxes: Regions) -> None:
        observed, root = fit.observed, np.sqrt(fit.noise)
        self.data, self.prior = fit.absorbed
        self.trust, self.count, self.root = observed.trusts, len(observed), root
        self.boxes = [(boxes.members * reading.unit_loss / root[i]).astype(np.float32)
                      for i, reading in enumerate(observed.readings)]
        self.effect = np.stack([change for _, _, change in screen(fit)]) / root[:, None]
        self.box_norms = [_norms(np.sum(box**2, axis=1), box @ self.data[i])
                          for i, box in enumerate(self.boxes)]
        self.effect_norm = _norms(np.sum(self.effect**2, axis=(1, 2)),
                                  np.einsum("mcn,cnp->mp", self.effect, self.data))
        self.used = np.sum(self.data**2, axis=(1, 2))  # degrees of freedom by channel

    def left(self, data: Array, prior: Array) -> Array:
        """What a refit leaves of k campaigns, shape (k, channels, n); `prior` (k, p)."""
        shadow = np.einsum("kcn,cnp->kp", data, self.data) + prior @ self.prior
        return np.asarray(data - np.einsum("kp,cnp->kcn", shadow, self.data))

    def statistics(self, data: Array, prior: Array) -> tuple[Array, Array]:
        """z of every box (channel by channel) and every effect, for k campaigns.

        `data` has shape (k, channels, n); the answers (k, channels x boxes) and (k, effects).
        """
        left = self.left(data, prior)
        squares = np.sum(left**2, axis=2)
        scale = np.sqrt((self.trust + squares)
                        / (self.trust + np.maximum(self.count - self.used, 1.0)))
        left = left / scale[..., None]
        boxes = np.concatenate([
            (left[:, i].astype(np.float32) @ box.T) / self.box_norms[i]
            for i, box in enumerate(self.boxes)], axis=1)
        effects = np.einsum("kcn,mcn->km", left, self.effect) / self.effect_norm
        return boxes.astype(float), effects


def _lack_of_fit(search: _Search, white: Array) -> float:
    """Chance of so much scatter at the noise stated (F test, worth of the statement counted)."""
    from scipy.stats import f

    left = search.left(white[None], np.zeros((1, len(search.prior))))[0, 0] * search.root[0]
    free = max(left.size - float(search.used[0]), 1.0)
    return float(f.sf(np.sum(left**2) / free, free, search.trust[0]))


def _norms(squares: NDArray[Any], shadow: NDArray[Any]) -> Array:
    total = squares.astype(np.float64)
    left = total - np.sum(shadow.astype(np.float64) ** 2, axis=1)
    # A column that the refit absorbs whole can show nothing.
    return np.asarray(np.sqrt(np.where(left > 1e-6 * total, left, np.inf)), dtype=np.float64)


def _top(z: Array) -> Array:
    return np.asarray(np.abs(z).max(axis=1) if z.shape[1] else np.zeros(len(z)), dtype=np.float64)


def _p_values(null: Array, values: Array) -> Array:
    above = len(null) - np.searchsorted(np.sort(null), values, side="left")
    return np.asarray((1.0 + above) / (1.0 + len(null)), dtype=np.float64)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Is there a gap, and where: boxes over the samples, each looked at, and what that costs.

Whoever looks at thousands of regions and dozens of effects finds something. The statistic is
therefore the maximum over everything looked at, and its distribution without a gap comes from
simulated campaigns put through the same refit (max-T; Westfall & Young 1993). Noise is estimated
from the residuals in each of them, as it is in the real one, so that noise stated wrongly does not
raise alarms.
"""

import itertools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .hypothesis import Fit
from .observations import FEW
from .system import Array

REPLICATES = 999
_CHUNK = 64
_LEAST_SAMPLES = 4
_SAMPLES_PER_LEAST = 8
_BAND_EDGES = 21  # edges per axis for bands along one axis
_CORNER_EDGES = 6  # edges per axis for boxes over two and three axes
_PAYS = 0.05  # of F1: by how much a further region has to tell the places better


@dataclass(frozen=True, eq=False)
class Regions:
    """Boxes over the samples.

    Attributes:
        members: which samples each box holds, shape (boxes, n).
        low, high: limits of each box by axis, shape (boxes, axes).
    """

    members: NDArray[np.bool_]
    low: Array
    high: Array

    def __len__(self) -> int:
        return len(self.members)


def regions(place: Array) -> Regions:
    """Bands along each axis, and corners over two and more axes, with at least four samples each.

    Below 32 samples an eighth of them is enough, down to one.

    Edges lie midway between neighbouring samples, so a region is as narrow as the data allow.
    Regions that hold the same samples are listed once; the narrower in extent stands for them.
    """
    extent = [(float(values.min()), float(values.max())) for values in place]
    bands = [_intervals(_edges(values, _BAND_EDGES)) for values in place]
    # A corner is one-sided on each axis: high load at low speed, and so on.
    sides = [
        [
            pair
            for pair in _intervals(edges)
            if pair[0] == edges[0] or pair[1] == edges[-1]
        ]
        for edges in (_edges(values, _CORNER_EDGES) for values in place)
    ]
    boxes: list[tuple[tuple[float, float], ...]] = []
    for size in range(1, len(place) + 1):
        for axes in itertools.combinations(range(len(place)), size):
            own = bands if size == 1 else sides
            boxes += itertools.product(
                *(
                    own[axis] if axis in axes else [limits]
                    for axis, limits in enumerate(extent)
                )
            )
    limits = np.array(boxes).reshape(-1, len(place), 2)
    low, high = limits[..., 0], limits[..., 1]
    members = np.ones((len(limits), place.shape[1]), dtype=bool)
    for axis, values in enumerate(place):
        members &= (values >= low[:, axis, None]) & (values <= high[:, axis, None])
    n, inside = place.shape[1], members.sum(axis=1)
    least = max(1, min(_LEAST_SAMPLES, n // _SAMPLES_PER_LEAST))
    first: dict[bytes, int] = {}
    for i in np.flatnonzero((inside >= least) & (inside <= n - least)).tolist():
        first.setdefault(members[i].tobytes(), i)
    kept = list(first.values())
    return Regions(members[kept], low[kept], high[kept])


def _edges(values: Array, most: int) -> Array:
    distinct = np.unique(values)
    if len(distinct) < 2:
        return np.array([])
    middles = (distinct[1:] + distinct[:-1]) / 2.0
    if len(middles) > most:
        # Evenly in samples, so that every band can hold enough of them.
        wanted = np.quantile(values, np.linspace(0.0, 1.0, most + 2)[1:-1])
        nearest = np.searchsorted(middles, wanted).clip(0, len(middles) - 1)
        middles = middles[np.unique(nearest)]
    return np.concatenate([[distinct[0]], middles, [distinct[-1]]])


def _intervals(edges: Array) -> list[tuple[float, float]]:
    pairs = itertools.combinations(range(len(edges)), 2)
    return [
        (float(edges[i]), float(edges[j]))
        for i, j in pairs
        if not (i == 0 and j == len(edges) - 1)
    ]


def covering(
    members: NDArray[np.bool_], target: NDArray[np.bool_], most: int
) -> list[int]:
    """The fewest regions that hold some points and no others, by F1, one after another.

    With each that is added the others are exchanged while that is better.

    Args:
        members: which points each region holds, shape (regions, n).
        target: the points, shape (n,).
        most: regions.
    """
    chosen, reached = list[int](), 0.0
    for count in range(1, most + 1):
        tried, best, before = [*chosen, 0], reached, -1.0
        while best > before:
            before = best
            for place in (count - 1, *range(count - 1)):
                union = members | members[tried[:place] + tried[place + 1 :]].any(
                    axis=0
                )
                f1 = (
                    2.0
                    * (union & target).sum(axis=1)
                    / (union.sum(axis=1) + target.sum())
                )
                if f1.max() > best:
                    tried[place], best = int(f1.argmax()), float(f1.max())
        if best < reached + _PAYS:
            break
        chosen, reached = tried, best
    return chosen


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
    look, p = _Search(fit, boxes), len(fit.theta)
    white = fit.target / np.sqrt(fit.noise)[:, None]
    found, effects = look(white[None], np.zeros((1, p)))
    rng, tops = np.random.default_rng(seed), []
    for start in range(0, replicates, _CHUNK):
        count = min(_CHUNK, replicates - start)
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
    if len(fit.observed) < FEW:
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
        n, self.trust = len(observed), observed.trust
        # Which readings, one channel after another, and how they change; each channel by itself,
        # that none has to be right for another to show a gap.
        looks = [
            (slice(i * n, (i + 1) * n), (boxes.members * loss).astype(np.float32))
            for i, loss in enumerate(
                np.einsum("iin->in", observed.unit_loss) / self.root[:, None]
            )
        ]
        effects = (
            np.stack([change for _, change in fit.signatures]) / self.root[:, None]
        )
        looks.append((slice(effects[0].size), effects.reshape(len(effects), -1)))
        self.looks = [
            (own, look, _norms(np.sum(look**2, axis=1), look @ fit.absorbed[own]))
            for own, look in looks
        ]
        # Degrees of freedom by channel.
        used = np.sum(
            fit.absorbed[: self.root.size * n].reshape(self.root.size, -1) ** 2, axis=1
        )
        self.free = np.maximum(n - used, 1.0)

    def __call__(self, data: Array, prior: Array) -> tuple[Array, Array]:
        """Return |z| of boxes, (k, channels, boxes), and of effects, (k, effects).

        Of k campaigns, `data` of shape (k, channels, n) and `prior` (k, p).
        """
        left = self.fit.left(data, prior)[:, : data[0].size].reshape(data.shape)
        scale = np.sqrt(
            (self.trust + np.sum(left**2, axis=2)) / (self.trust + self.free)
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

        left = self.fit.left(white[None])[0, : white.shape[1]] * self.root[0]
        free = float(self.free[0])
        return float(fdtrc(free, self.trust[0], np.sum(left**2) / free))


def _norms(squares: NDArray[Any], shadow: NDArray[Any]) -> Array:
    total = squares.astype(np.float64)
    left = total - np.sum(shadow.astype(np.float64) ** 2, axis=1)
    # A column that the refit absorbs whole can show nothing.
    return np.asarray(
        np.sqrt(np.where(left > 1e-6 * total, left, np.inf)), dtype=np.float64
    )


def _tops(boxes: Array, effects: Array) -> Array:
    """Largest |z| of all boxes and of all effects, shape (2, k)."""
    return np.stack(
        [boxes.max(axis=(1, 2), initial=0.0), effects.max(axis=1, initial=0.0)]
    )


def _p_values(null: Array, values: Array) -> Array:
    above = len(null) - np.searchsorted(np.sort(null), values, side="left")
    return np.asarray((1.0 + above) / (1.0 + len(null)), dtype=np.float64)

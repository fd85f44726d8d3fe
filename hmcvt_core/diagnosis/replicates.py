# SPDX-License-Identifier: Apache-2.0
"""Which samples repeat one operating point: a bench never sets a point twice to the last digit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples

Array = NDArray[np.float64]

TOLERANCE = 0.002
"""Samples so close in every axis repeat one point; a part of the range of the axis."""

# How closely a bench holds a point, whatever the range: stroke, 1 r/min, N m, deg C.
_HELD = {"displacement_ratio": 0.001, "engine_speed": 0.105, "load_torque": 0.2,
         "oil_temperature": 1.0}


def replicate_groups(samples: BenchSamples) -> NDArray[np.intp]:
    """Number the distinct operating points, shape (n,); repeated points share a number.

    The sample with most neighbours gathers them, then the next: a slow sweep, in which every
    sample is close to the next one, falls into pieces instead of becoming one point.
    """
    from scipy.spatial import cKDTree

    points = _scaled(samples)
    near = cKDTree(points).query_ball_point(points, 1.0, p=np.inf)
    count = np.array([len(indices) for indices in near])
    group = np.full(len(points), -1, dtype=np.intp)
    # Ties by place, so that the order of the rows does not matter.
    leaders: list[int] = []
    for i in np.lexsort((*points.T[::-1], -count)).tolist():
        if group[i] < 0:
            members = np.array(near[i])
            group[members[group[members] < 0]] = len(leaders)
            leaders.append(i)
    order = np.lexsort(points[leaders].T[::-1])
    number = np.empty(len(leaders), dtype=np.intp)
    number[order] = np.arange(len(leaders))
    return np.asarray(number[group])


def _scaled(samples: BenchSamples) -> Array:
    """Operating points in tolerances, shape (n, axes)."""
    columns = []
    for name, held in _HELD.items():
        values = getattr(samples, name)
        if values is not None:
            columns.append(values / max(TOLERANCE * float(np.ptp(values)), held))
    return np.stack(columns, axis=1)

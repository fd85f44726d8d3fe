# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A model brought to wanted efficiencies by bumps of engine torque, in each stage by itself."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.analysis import rms
from ...diagnosis.system import Array
from ...model.model import EfficiencyModel
from ...physics.effects.empirical import EmpiricalLoss
from ...transmission.ranges import OperatingPoints
from .channels import AXES, OIL_TEMPERATURE, STAGE

MAX_BUMPS = 48
"""Maximum number of bumps of a model. Limit of computing time of the served model."""
MIN_BUMPS = 6
"""Bumps of a stage at least, if it has as many samples."""
WIDTHS = (0.1, 0.2, 0.4, 0.8)
"""Widths that are tried along each axis, as fractions of its range."""
RIDGE = 1e-6
"""Fraction of the mean square of a column that is added to the diagonal against rounding."""
NEGLIGIBLE = 2e-4
"""Difference of the efficiency below which a model needs no bump [-]; chosen, 0.02 points."""


def with_bumps(
    model: EfficiencyModel,
    points: Mapping[str, Array],
    wanted: Array,
    samples: int,
    stages: Sequence[str],
    deviation: float,
) -> tuple[EfficiencyModel, int]:
    """Return a model with bumps that bring it to wanted efficiencies, and their number.

    Args:
        model: to which they are added.
        points: the samples of a campaign, then further tests, n values by the name of the axis.
        wanted: efficiency at these points [-], shape (n,); NaN where it is not known.
        samples: number of samples among the points.
        stages: names of the stages, in the order of their numbers.
        deviation: prior standard deviation of a smooth remainder [-], which the model states.
    """
    number = points.get(STAGE.name, np.zeros(len(wanted))).astype(int)
    present = np.unique(number[:samples])
    most = max(MAX_BUMPS // len(present), MIN_BUMPS)
    effects: list[EmpiricalLoss] = []
    for i in present:
        rows = np.flatnonzero(number == i)
        of_samples = int(np.sum(rows < samples))
        name = stages[i] if len(stages) > 1 else ""
        part = model.stages.get(name, model)
        effects += _bumps_of(part, points, wanted, rows, of_samples, most, name)
    if not effects:
        return model, 0
    provenance = {
        **model.provenance,
        "empirical_remainder": {
            "bumps": len(effects),
            "standard_deviation": float(f"{deviation:.4g}"),
        },
    }
    added = replace(
        model,
        effects=(*model.effects, *effects),
        provenance=provenance,
        remainder_deviation=deviation,
    )
    return added, len(effects)


def _bumps_of(
    model: EfficiencyModel,
    points: Mapping[str, Array],
    wanted: Array,
    rows: NDArray[np.intp],
    samples: int,
    most: int,
    stage: str,
) -> list[EmpiricalLoss]:
    """Return the bumps of one stage; none where it is near enough.

    Args:
        model: of the stage.
        points: of all stages.
        wanted: efficiency at them [-].
        rows: those of the stage, its samples first.
        samples: number of its samples.
        most: bumps at most.
        stage: its name; empty where there is one only.
    """
    axes = np.stack([points[axis.name][rows] for axis in AXES], axis=1)
    oil = points.get(OIL_TEMPERATURE.name)
    stroke, speed, load = axes.T
    temperature = None if oil is None else oil[rows]
    at = OperatingPoints(stroke, speed, load, temperature)
    predicted = model.readings_at(at)["efficiency"]
    target = wanted[rows]
    usable = np.isfinite(predicted) & np.isfinite(target) & (target > 0.0)
    usable &= predicted > 0.0
    if usable.sum() < MIN_BUMPS or rms((target - predicted)[usable]) < NEGLIGIBLE:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        torque = load * (1.0 / target - 1.0 / predicted)
        slope = predicted**2 / load
    low = axes[:samples].min(axis=0)
    width = np.maximum(np.ptp(axes[:samples], axis=0), 1e-6)
    scaled = (axes - low) / width
    known = scaled[usable]
    centres = known[_spread(known, min(most, samples))]
    fits = []
    for fractions in itertools.product(WIDTHS, repeat=scaled.shape[1]):
        widths = np.array(fractions)
        heights, left = _heights(scaled, centres, widths, torque, slope, usable)
        fits.append((left, widths, heights))
    _, widths, heights = min(fits, key=lambda fit: fit[0])
    stroke_width, speed_width, load_width = (widths * width).tolist()
    bumps = []
    for centre, height in zip((low + centres * width).tolist(), heights, strict=True):
        stroke_of, speed_of, load_of = centre
        bumps.append(
            EmpiricalLoss(
                torque=float(height),
                stroke=stroke_of,
                speed=speed_of,
                load=load_of,
                stroke_width=stroke_width,
                speed_width=speed_width,
                load_width=load_width,
                stage=stage,
            )
        )
    return bumps


def _heights(
    scaled: Array,
    centres: Array,
    widths: Array,
    torque: Array,
    slope: Array,
    usable: NDArray[np.bool_],
) -> tuple[Array, float]:
    """Return the heights of bumps [N m], and the efficiency that they leave, rms [-].

    Args:
        scaled: points, shape (n, 3).
        centres: shape (bumps, 3).
        widths: of the bumps, as fractions of the ranges, shape (3,).
        torque: that is wanted [N m], shape (n,).
        slope: change of the efficiency by a torque [1/(N m)], shape (n,).
        usable: which points count, shape (n,).
    """
    from scipy.spatial.distance import cdist

    columns = np.exp(-0.5 * cdist(scaled / widths, centres / widths) ** 2)
    design = (slope[:, None] * columns)[usable]
    target = (slope * torque)[usable]
    gram = design.T @ design
    gram += RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram))
    heights = np.linalg.solve(gram, design.T @ target)
    return heights, rms(target - design @ heights)


def _spread(points: Array, count: int) -> NDArray[np.intp]:
    """Return indices of points far from each other, the one nearest to the middle first.

    Args:
        points: shape (n, d).
        count: of the indices.
    """
    middle = points.mean(axis=0)
    chosen = [int(np.argmin(np.sum((points - middle) ** 2, axis=1)))]
    nearest = np.sum((points - points[chosen[0]]) ** 2, axis=1)
    while len(chosen) < count:
        farthest = int(np.argmax(nearest))
        chosen.append(farthest)
        squared = np.sum((points - points[farthest]) ** 2, axis=1)
        nearest = np.minimum(nearest, squared)
    return np.array(chosen)

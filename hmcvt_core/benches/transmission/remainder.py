# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a diagnosis leaves unexplained, put into the model as an empirical remainder.

The engine torque that the model misses is fitted by a sum of Gaussian bumps over stroke, engine
speed and load (`hmcvt_core.physics.effects.empirical`), with normal priors of their heights. The
width along each axis and the prior are those of the least error at samples left out; where none
lowers it, nothing is added. The error that counts is that of samples left out of this choice, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import Diagnosis
from ...diagnosis.analysis import rms
from ...diagnosis.system import Array
from ...files.bench import BenchSamples
from ...model.accuracy import misfit
from ...model.model import EfficiencyModel
from ...physics.effects.empirical import EmpiricalLoss
from .misfit import believed_noise, parameter_errors

MOST_BUMPS = 40
"""Most bumps of a remainder. Limit of computing time of the served model."""
SAMPLES_PER_BUMP = 2
"""Fewest samples for each bump; chosen. The prior of the heights does the smoothing."""
WIDTHS = (0.1, 0.2, 0.35, 0.6, 1.0, 3.0)
"""Widths that are tried, as parts of the range of each axis; at the last the axis hardly counts."""
START_WIDTH = 0.6
"""Width along every axis with which the search begins."""
SWEEPS = 2
"""Times that each axis takes its best width in turn (coordinate descent)."""
HEIGHTS = (0.3, 1.0, 3.0, 10.0, 30.0)
"""Prior deviations of the heights that are tried, in the root mean square of the torque missed."""
FOLDS = 8
"""Random parts of the samples; each is predicted from the others."""
LEAST_GAIN = 0.95
"""Ratio of errors at samples left out below which a remainder is added; chosen.

A smaller gain may be chance.
"""
LEAST_SAMPLES = 48
"""Fewest samples of a remainder.

Of 24 tests it hardly helped, and made one model in eight 2.3 times worse (docs/identify.md).
"""


@dataclass(frozen=True, eq=False)
class EmpiricalRemainder:
    """A remainder and its errors at samples left out.

    Attributes:
        model: with the remainder, or without where it lowers no error.
        bumps: number of bumps that are added.
        rmse_without: error of the efficiency of the model without it [-].
        rmse_with: error with the remainder at samples left out of its fit [-]; the standard
            deviation of the remainder and the noise together.
    """

    model: EfficiencyModel
    bumps: int
    rmse_without: float
    rmse_with: float


def with_empirical_remainder(diagnosis: Diagnosis) -> EmpiricalRemainder:
    """Return the model of a diagnosis with what it leaves of the samples.

    Args:
        diagnosis: of a transmission; the remainder is fitted around its `model`.
    """
    model: EfficiencyModel = diagnosis.model
    samples: BenchSamples = diagnosis.samples
    predicted = model.readings_at(samples.points)[0]
    answered = np.isfinite(predicted)
    index = np.flatnonzero(answered)
    samples = samples.select(index)
    predicted = predicted[index]
    error = samples.efficiency - predicted
    without = float(np.sqrt(np.mean(error**2)))
    nothing = EmpiricalRemainder(model, 0, without, without)
    if len(index) < LEAST_SAMPLES or _stages_of(samples) > 1:
        return nothing
    bumps = _Bumps.of(samples, predicted)
    missed = bumps.nested_errors()
    left_out = rms(missed)
    if left_out > LEAST_GAIN * without:
        return nothing
    effects = bumps.effects(*bumps.best_shape())
    provenance = {
        **model.provenance,
        "empirical_remainder": {
            "bumps": len(effects),
            "standard_deviation": float(f"{left_out:.4g}"),
        },
    }
    fitted = replace(model, effects=(*model.effects, *effects), provenance=provenance)
    errors = parameter_errors(fitted, samples)
    fitted = replace(fitted, misfit=misfit(missed, believed_noise(diagnosis), errors))
    return EmpiricalRemainder(fitted, len(effects), without, left_out)


def _stages_of(samples: BenchSamples) -> int:
    if samples.stage is None:
        return 1
    return len(set(np.asarray(samples.stage).tolist()))


@dataclass(frozen=True, eq=False)
class _Bumps:
    """Torque that a model misses at samples, and the centres of bumps.

    Attributes:
        scaled: operating points, axes scaled by their range, shape (n, 3).
        low: lowest value along each axis, shape (3,).
        width: range of each axis, shape (3,).
        centres: of the bumps, scaled like the samples, shape (bumps, 3).
        torque: engine torque missed [N m], shape (n,).
        per_torque: change of the efficiency by a torque on the engine [1/(N m)], shape (n,).
    """

    scaled: Array
    low: Array
    width: Array
    centres: Array
    torque: Array
    per_torque: Array

    @classmethod
    def of(cls, samples: BenchSamples, predicted: Array) -> _Bumps:
        """Return the bumps of samples.

        Args:
            samples: of one stage.
            predicted: efficiency of the model at their points, shape (n,).
        """
        points = np.stack(
            [samples.displacement_ratio, samples.engine_speed, samples.load_torque], 1
        )
        low = points.min(axis=0)
        width = np.maximum(np.ptp(points, axis=0), 1e-6)
        scaled = (points - low) / width
        load = samples.load_torque
        torque = load * (1.0 / samples.efficiency - 1.0 / predicted)
        count = min(MOST_BUMPS, len(samples) // SAMPLES_PER_BUMP)
        per_torque = -(predicted**2) / load
        centres = scaled[_spread(scaled, count)]
        return cls(scaled, low, width, centres, torque, per_torque)

    def nested_errors(self) -> Array:
        """Return errors of the efficiency at samples left out of fit and choice [-], shape (n,)."""
        n = len(self.torque)
        errors = np.empty(n)
        for rows in _folds(n):
            kept = np.setdiff1d(np.arange(n), rows)
            widths, height = self.select(kept).best_shape()
            errors[rows] = self._errors_at(rows, kept, widths, height)
        return errors

    def select(self, rows: NDArray[np.intp]) -> _Bumps:
        """Return the same bumps with some of the samples."""
        return replace(
            self,
            scaled=self.scaled[rows],
            torque=self.torque[rows],
            per_torque=self.per_torque[rows],
        )

    def best_shape(self) -> tuple[Array, float]:
        """Return the widths along the axes, shape (3,), and the prior of least error left out."""
        widths = np.full(len(self.low), START_WIDTH)
        height = self._best_height(widths)
        for _ in range(SWEEPS):
            for axis in range(len(widths)):
                errors = []
                for width in WIDTHS:
                    widths[axis] = width
                    errors.append(rms(self._left_out_errors(widths, height)))
                widths[axis] = WIDTHS[int(np.argmin(errors))]
            height = self._best_height(widths)
        return widths, height

    def _best_height(self, widths: Array) -> float:
        """Return the prior deviation of the heights of least error at samples left out."""
        errors = [rms(self._left_out_errors(widths, height)) for height in HEIGHTS]
        return HEIGHTS[int(np.argmin(errors))]

    def _left_out_errors(self, widths: Array, height: float) -> Array:
        """Return the errors of the efficiency at samples left out of the fit [-], shape (n,)."""
        n = len(self.torque)
        errors = np.empty(n)
        for rows in _folds(n):
            kept = np.setdiff1d(np.arange(n), rows)
            errors[rows] = self._errors_at(rows, kept, widths, height)
        return errors

    def _errors_at(
        self,
        rows: NDArray[np.intp],
        kept: NDArray[np.intp],
        widths: Array,
        height: float,
    ) -> Array:
        """Return the errors of the efficiency at some samples, of a fit to others [-].

        Args:
            rows: samples that are predicted.
            kept: samples that are fitted.
            widths: of the bumps along the axes, shape (3,).
            height: prior deviation of the heights / root mean square of the torque.
        """
        columns = self._columns(widths)
        heights = self._heights(columns, kept, height)
        missed = self.torque[rows] - columns[rows] @ heights
        return self.per_torque[rows] * missed

    def effects(self, widths: Array, height: float) -> list[EmpiricalLoss]:
        """Return the bumps fitted to all samples."""
        columns = self._columns(widths)
        heights = self._heights(columns, np.arange(len(self.torque)), height)
        stroke_width, speed_width, load_width = (widths * self.width).tolist()
        effects = []
        for centre, torque in zip(self.centres, heights.tolist(), strict=True):
            stroke, speed, load = (self.low + centre * self.width).tolist()
            effects.append(
                EmpiricalLoss(
                    torque=torque,
                    stroke=stroke,
                    speed=speed,
                    load=load,
                    stroke_width=stroke_width,
                    speed_width=speed_width,
                    load_width=load_width,
                )
            )
        return effects

    def _columns(self, widths: Array) -> Array:
        """Return the bumps of height one at the samples, shape (n, bumps)."""
        from scipy.spatial.distance import cdist

        distance = cdist(self.scaled / widths, self.centres / widths)
        return np.asarray(np.exp(-0.5 * distance**2))

    def _heights(self, columns: Array, rows: NDArray[np.intp], prior: float) -> Array:
        """Return the heights of the bumps [N m], shape (bumps,): the posterior mean.

        Args:
            columns: bumps of height one, shape (n, bumps).
            rows: samples that are fitted.
            prior: deviation of the heights / root mean square of the torque.
        """
        weights = np.abs(self.per_torque[rows])
        target = weights * self.torque[rows]
        design = weights[:, None] * columns[rows]
        noise = float(np.mean(target**2))
        deviation = prior * float(np.sqrt(np.mean(self.torque[rows] ** 2)))
        ridge = noise / max(deviation, 1e-12) ** 2
        gram = design.T @ design + ridge * np.eye(design.shape[1])
        return np.asarray(np.linalg.solve(gram, design.T @ target))


def _folds(count: int) -> list[NDArray[np.intp]]:
    """Return the positions of samples in random folds."""
    order = np.random.default_rng(0).permutation(count)
    return np.array_split(order, FOLDS)


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

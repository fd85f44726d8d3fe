# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The saved model of a unit: never worse than the terms of the paper alone.

Three models predict the losses: the terms of the paper, these with the leading set of effects, and
the terms of real units with a smooth remainder (`sound`). They are mixed by stacking (Wolpert 1992;
Breiman 1996): with weights that are not negative, sum to one and have the least squared error at
samples left out. Random parts of the samples give the weights within the tests. The highest and the
lowest fifth of an axis, predicted from the rest, give the weights beyond the tests along it. Where
the mixture predicts a part no better than the terms of the paper, these are kept.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.analysis import rms
from ...diagnosis.fitting.hypothesis import Hypothesis
from ...diagnosis.fitting.refit import refit
from ...diagnosis.settings import CONVERGED_STEP
from ...diagnosis.system import Array, Axis
from .samples import UnitSamples
from .sound import ChangedUnit, fit_sound_unit
from .system import (
    FRICTION,
    PRESSURE,
    SPEED,
    STROKE,
    HydrostaticUnit,
    UnitModel,
    loss_errors,
    observe_unit,
)

FOLDS = 4
"""Random parts of the samples; each is predicted from the others."""
BAND_FRACTION = 0.2
"""Fraction of the samples at either end of an axis that is predicted from the rest: a fifth."""
HIGH = "high"
LOW = "low"
SIDES = (HIGH, LOW)
"""Ends of an axis."""
GATE = 0.85
"""Ratio of errors at samples left out above which the terms of the paper are kept.

With some 20 samples an error is known to about 15 %.
"""
FARTHEST_POWER = 6
"""Power of the distance by which bands share a point; chosen.

A band that a point lies beyond outweighs those in which it only lies.
"""
MIN_FITTED = 10
"""Fewest samples from which a band is predicted: two for each term of a loss."""
SUM_WEIGHT = 1e3
"""Weight of the condition that weights sum to one, against errors of size one."""
BAND_AXES = (PRESSURE, SPEED, STROKE)
INSIDE = "inside"
"""Name of the weights within the tests."""
WORSE = 1.05
"""Ratio of errors at samples left out above which a model counts as worse; chosen.

With some 20 samples an error is known to about 15 %, but those of two models share the noise.
"""


class Predictor(Protocol):
    """A model that predicts losses of a unit."""

    def predict(self, samples: UnitSamples) -> dict[str, Array]:
        """Return losses by channel at the points of samples, shape (n,) each."""


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of the models for one band of the operating points.

    Attributes:
        band: `inside`, or the axis along which the band lies.
        side: end of the axis, `high` or `low`; empty for `inside`.
        start: value of the sample next to the band; 0 for `inside`.
        end: outermost value of the samples; 0 for `inside`.
        models: weight of each model, by channel and model.
        errors: root mean square error at samples left out, by channel and model; `served` is that
            of the mixture.
    """

    band: str
    side: str
    start: float
    end: float
    models: Mapping[str, Mapping[str, float]]
    errors: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, eq=False)
class ServedUnit:
    """The models of a unit, mixed by their errors at samples left out.

    Attributes:
        models: by name, `base` first.
        bands: weights inside the tests first.
        samples: that were fitted.
    """

    models: Mapping[str, Predictor]
    bands: tuple[Weights, ...]
    samples: UnitSamples

    def predict(self, samples: UnitSamples) -> dict[str, Array]:
        """Return losses by channel at the points of samples, shape (n,) each."""
        return self._mixed(self._predictions(samples), self._parts_of_bands(samples))

    def deviation(self, samples: UnitSamples) -> dict[str, Array]:
        """Return standard deviations of the prediction by channel, shape (n,) each.

        Their variance is the squared error of the mixture at samples left out, plus the variance of
        the models around the mixture (Hoeting et al. 1999, Stat. Sci. 14, 382, eq. 2). Beyond the
        samples the error grows in proportion to the distance, in widths of the band left out.
        """
        distances = self._distances(samples)
        parts = self._parts_of_bands(samples)
        growth = np.maximum(distances, 1.0) ** 2
        predictions = self._predictions(samples)
        mixture = self._mixed(predictions, parts)
        deviations = {}
        for channel in self.bands[0].errors:
            variance = np.zeros(len(samples))
            for part, factor, band in zip(parts, growth, self.bands, strict=True):
                variance += part * factor * band.errors[channel]["served"] ** 2
                for name, weight in band.models[channel].items():
                    apart = predictions[name][channel] - mixture[channel]
                    variance += part * weight * apart**2
            deviations[channel] = np.sqrt(variance)
        return deviations

    def rmse(self, samples: UnitSamples) -> list[float | None]:
        """Return the root mean square error of both losses [m3/s], [N m]; None where not read."""
        return loss_errors(self.predict(samples), samples)

    def notes(self) -> list[str]:
        """Return notes on where the terms of the paper are kept, or predict better than effects."""
        notes = []
        for channel in self.bands[0].models:
            kept = [band for band in self.bands if band.models[channel]["base"] == 1.0]
            if kept:
                where = ", ".join(f"{band.side} {band.band}".strip() for band in kept)
                notes.append(
                    f"{channel.removesuffix('_loss')}: nothing predicts samples left out better "
                    f"than the terms of the paper, which are kept: {where}"
                )
        for band in self.bands:
            for channel, errors in band.errors.items():
                if errors.get("with_effects", 0.0) <= WORSE * errors["base"]:
                    continue
                where = "samples left out at random"
                if band.band != INSIDE:
                    where = f"the fifth of {band.side} {band.band}, left out"
                percent = 100.0 * band.models[channel]["with_effects"]
                notes.append(
                    f"{channel.removesuffix('_loss')}: the effects predict {where} worse than "
                    "the terms of the paper do; they have a weight of "
                    f"{percent:.0f} % in the saved model there"
                )
        return notes

    def to_dict(self) -> list[dict[str, Any]]:
        """Return the weights as a JSON array."""
        rows = []
        for band in self.bands:
            weights = {channel: dict(models) for channel, models in band.models.items()}
            errors = {channel: dict(models) for channel, models in band.errors.items()}
            rows.append(
                {
                    "band": band.band,
                    "side": band.side,
                    "weights": weights,
                    "rmse": errors,
                }
            )
        return rows

    def _predictions(self, samples: UnitSamples) -> dict[str, dict[str, Array]]:
        """Return the losses of each model by channel, shape (n,) each."""
        return {name: model.predict(samples) for name, model in self.models.items()}

    def _mixed(
        self, predictions: Mapping[str, Mapping[str, Array]], parts: Array
    ) -> dict[str, Array]:
        """Return the losses of the mixture by channel, shape (n,) each.

        Args:
            predictions: of each model, by channel.
            parts: of each band, shape (bands, n).
        """
        losses = {}
        for channel in self.bands[0].models:
            mixture = np.zeros(parts.shape[1])
            for part, band in zip(parts, self.bands, strict=True):
                for name, weight in band.models[channel].items():
                    mixture += part * weight * predictions[name][channel]
            losses[channel] = mixture
        return losses

    def _parts_of_bands(self, samples: UnitSamples) -> Array:
        """Return the part of each band at the points of samples, shape (bands, n).

        The parts of all bands but `inside` rise from 0 where a band begins to 1 at the outermost
        value of the samples. Of several bands the one counts most of which a point lies farthest
        out.
        """
        distances = self._distances(samples)
        beyond = np.minimum(distances.max(axis=0), 1.0)
        farthest = np.maximum(distances.max(axis=0), 1e-300)
        shares = (distances / farthest) ** FARTHEST_POWER
        parts = beyond * shares / np.maximum(shares.sum(axis=0), 1e-300)
        parts[0] = 1.0 - beyond
        return np.asarray(parts)

    def _distances(self, samples: UnitSamples) -> Array:
        """Return how far points lie in each band, in its width, shape (bands, n).

        The distance is 1 at the outermost value of the samples.
        """
        distances = np.zeros((len(self.bands), len(samples)))
        for i, band in enumerate(self.bands):
            if band.band == INSIDE:
                continue
            values = getattr(samples, band.band)
            width = band.end - band.start
            distances[i] = np.maximum((values - band.start) / width, 0.0)
        return distances


def served_unit(
    system: HydrostaticUnit, samples: UnitSamples, effects: Sequence[Any]
) -> ServedUnit:
    """Return the saved model of a unit.

    Args:
        system: the unit.
        samples: to which it is fitted.
        effects: the leading set, at its fitted sizes; empty where none leads.
    """
    n = len(samples)
    order = np.random.default_rng(0).permutation(n)
    folds = [np.sort(part) for part in np.array_split(order, FOLDS)]
    bands = [_weights(system, samples, effects, INSIDE, "", folds)]
    for axis in BAND_AXES:
        for side in SIDES:
            rows = _band_rows(samples, axis, side)
            if rows is not None:
                bands.append(
                    _weights(system, samples, effects, axis.name, side, [rows])
                )
    models = _fitted(system, samples, effects)
    return ServedUnit(models, tuple(bands), samples)


def _band_rows(samples: UnitSamples, axis: Axis, side: str) -> NDArray[np.intp] | None:
    """Return the samples in the outermost fifth of an axis, or None where it has none."""
    values = getattr(samples, axis.name)
    # Tests of one grid value stay together, whatever their last digits.
    if side == HIGH:
        limit = np.quantile(values, 1.0 - BAND_FRACTION) - axis.tolerance
        is_left_out = values >= limit
    else:
        limit = np.quantile(values, BAND_FRACTION) + axis.tolerance
        is_left_out = values <= limit
    if np.sum(~is_left_out) < MIN_FITTED:
        return None
    return np.flatnonzero(is_left_out)


def _fitted(
    system: HydrostaticUnit, samples: UnitSamples, effects: Sequence[Any]
) -> dict[str, Predictor]:
    """Fit every model to samples."""
    channels = [channel.name for channel in system.channels]
    models: dict[str, Predictor] = {"base": paper_terms(system, samples)}
    if effects:
        # To the end: errors at samples left out decide between models by a few per cent.
        fit = refit(
            Hypothesis(system, tuple(effects)),
            observe_unit(system, samples),
            negligible=CONVERGED_STEP,
        )
        fitted: tuple[Any, ...] = fit.effects
        models["with_effects"] = UnitModel(system, fit.base, fitted)
    models["empirical"] = ChangedUnit(fit_sound_unit(samples, channels, ()), ())
    return models


def _weights(
    system: HydrostaticUnit,
    samples: UnitSamples,
    effects: Sequence[Any],
    band: str,
    side: str,
    parts: Sequence[NDArray[np.intp]],
) -> Weights:
    """Return the weights that predict parts of the samples best from the others.

    Args:
        system: the unit.
        samples: of the unit.
        effects: of the leading set.
        band: name of the band.
        side: end of the axis, empty for `inside`.
        parts: indices of the samples that are left out, one part at a time.
    """
    predicted = _left_out_predictions(system, samples, effects, parts)
    order = np.concatenate(parts)
    weights = {}
    errors = {}
    for channel in (item.name for item in system.channels):
        measured = getattr(samples, channel)[order]
        of_models = predicted[channel]
        weights[channel] = _stacked(of_models, measured)
        errors[channel] = {
            name: rms(measured - values) for name, values in of_models.items()
        }
        mixture = sum(weights[channel][name] * of_models[name] for name in of_models)
        errors[channel]["served"] = rms(measured - mixture)
        if errors[channel]["served"] > GATE * errors[channel]["base"]:
            weights[channel] = {name: float(name == "base") for name in of_models}
            errors[channel]["served"] = errors[channel]["base"]
    if band == INSIDE:
        return Weights(band, side, 0.0, 0.0, weights, errors)
    values = getattr(samples, band)
    outermost = np.max if side == HIGH else np.min
    start = float(outermost(np.delete(values, order)))
    return Weights(band, side, start, float(outermost(values)), weights, errors)


def _left_out_predictions(
    system: HydrostaticUnit,
    samples: UnitSamples,
    effects: Sequence[Any],
    parts: Sequence[NDArray[np.intp]],
) -> dict[str, dict[str, Array]]:
    """Return predictions of samples left out, by channel and model, one part after another.

    Arguments as of `_weights`.
    """
    every_row = np.arange(len(samples))
    predicted: dict[str, dict[str, list[Array]]] = {}
    for rows in parts:
        fitted = samples.select(np.setdiff1d(every_row, rows))
        left_out = samples.select(rows)
        for name, model in _fitted(system, fitted, effects).items():
            for channel, values in model.predict(left_out).items():
                predicted.setdefault(channel, {}).setdefault(name, []).append(values)
    joined = {}
    for channel, of_models in predicted.items():
        joined[channel] = {
            name: np.concatenate(values) for name, values in of_models.items()
        }
    return joined


def _stacked(predicted: Mapping[str, Array], measured: Array) -> dict[str, float]:
    """Return the weights of the least squared error, not negative, with the sum one.

    Args:
        predicted: of each model, shape (n,).
        measured: shape (n,).
    """
    from scipy.optimize import nnls

    errors = np.stack([values - measured for values in predicted.values()], axis=1)
    errors = errors / np.maximum(np.abs(errors).max(), 1e-300)
    columns = np.vstack([errors, np.full((1, errors.shape[1]), SUM_WEIGHT)])
    target = np.append(np.zeros(len(errors)), SUM_WEIGHT)
    solution, _ = nnls(columns, target)
    weights = solution / solution.sum()
    return dict(zip(predicted, weights.tolist(), strict=True))


def paper_terms(system: HydrostaticUnit, samples: UnitSamples) -> UnitModel:
    """Fit leakage and damping alone by weighted least squares; the meters count as exact."""
    _, ideal_torque = samples.ideal
    leakage = damping = 0.0
    if samples.flow_loss is not None:
        weight = samples.deviation_of("flow_loss") ** -2.0
        leakage = _slope(samples.pressure, samples.flow_loss, weight)
    if samples.torque_loss is not None:
        weight = samples.deviation_of("torque_loss") ** -2.0
        rubbed = samples.torque_loss - FRICTION * ideal_torque
        damping = _slope(samples.speed, rubbed, weight)
    base = np.array(
        [
            np.log10(leakage / system.size + 1e-16),
            damping / system.size,
            0.0,
            0.0,
            0.0,
        ]
    )
    return UnitModel(system, base, ())


def _slope(driver: Any, loss: Any, weight: Any) -> float:
    """Weighted least-squares slope of a line through the origin, not negative."""
    slope = np.sum(weight * driver * loss) / np.sum(weight * driver**2)
    return max(float(slope), 0.0)

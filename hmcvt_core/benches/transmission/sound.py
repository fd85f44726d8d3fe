# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A sound transmission as a baseline: the served model, refitted, and a smooth remainder.

The model is refitted to the sound samples, with the effects that a diagnosis of them names. What it
leaves of each channel is described by the base parameters, linearised around the refit, by the
errors of the meters, and by a Gaussian process over the operating point
(`hmcvt_core.benches.baseline.remainder`). Its uncertainty is that of the sound prediction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.observations import Observations
from ...diagnosis.results.outcome import Cause, ParameterEstimate
from ...diagnosis.settings import PRIOR_DOF_STATED
from ...diagnosis.system import Array, Axis, Channel, Points
from ...files.bench import BenchSamples
from ...model.domain import Domain
from ...model.model import EfficiencyModel
from ...physics.effects.wear import LaminarLeakage, ViscousDamping
from ..baseline import CLASS_TO_DRIFT, Growth, HeldMachine, min_widths, stacked
from ..baseline.remainder import Remainder, Training, fit_remainder
from .base import gauge_errors, scaled_base
from .channels import (
    DISPLACEMENT_RATIO,
    ENGINE_SPEED,
    LOAD_TORQUE,
    OIL_TEMPERATURE,
    STAGE,
    by_name,
)
from .meter_scale import with_scaled_zeros
from .meters import with_meter_errors
from .readings import observe
from .system import Transmission, shown_by

SOUND_AXES = (DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE, OIL_TEMPERATURE, STAGE)
MIN_WIDTHS = {
    DISPLACEMENT_RATIO.name: 0.5,
    OIL_TEMPERATURE.name: 20.0,
    STAGE.name: 1.0,
}
"""Minimum ranges for the remainder: half of one side of the stroke; 20 K halve the viscosity."""
STEP = 1e-2
"""Step of the derivative by a base parameter, in its prior deviations."""
WEAR = (LaminarLeakage, ViscousDamping)
"""Growth of what the base model has; candidates besides the library."""


@dataclass(frozen=True, eq=False)
class SoundTransmission(HeldMachine):
    """A sound transmission, held: a `SoundMachine`.

    Attributes:
        model: refitted to the sound samples.
        system: the model on its bench.
        channels: that are compared.
        remainders: what the model leaves of each channel.
        base: scaled base parameters of the model, shape (p,).
        samples: sound samples that were fitted.
        library: changes that are candidates.
        parameters: base parameters of the model with their standard errors.
        zeros: scales of the zeros of the torque meters, by `zero_scales`.
        inflation: factor of all standard deviations, above 1 where the control differs.
    """

    model: EfficiencyModel
    system: Transmission
    channels: tuple[Channel, ...]
    remainders: tuple[Remainder, ...]
    base: Array
    samples: BenchSamples
    library: tuple[Any, ...]
    parameters: Mapping[str, ParameterEstimate]
    zeros: Mapping[str, float] = field(default_factory=dict)
    inflation: float = 1.0
    _predicted: dict[bytes, Array] = field(default_factory=dict, repr=False)

    refusal = Transmission.refusal
    advice = Transmission.advice
    remainder_axes = SOUND_AXES

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of an operating point."""
        return self.system.axes

    @property
    def source(self) -> str:
        """Name of the file of the sound samples."""
        return self.samples.source

    def sound_at(self, points: Points) -> tuple[Array, Array]:
        """Return mean and covariance of the channels, shapes (channels, n), (channels, n, n)."""
        predicted = by_name(self._base_prediction(points))
        slopes = by_name(_slopes(self.system, self.base, points))
        means = []
        covariances = []
        for channel, remainder in zip(self.channels, self.remainders, strict=True):
            count = remainder.training.columns.shape[1]
            columns = _padded(slopes[channel.name], count)
            mean, covariance = remainder.predict(self.stacked(points), columns)
            means.append(predicted[channel.name] + mean)
            covariances.append(self.inflation**2 * covariance)
        return np.stack(means), np.stack(covariances)

    def changed_by_each(self, sets: Sequence[Sequence[Any]], points: Points) -> Array:
        """Return how each set of effects changes the channels, all solved together."""
        cases = [(self.base, effects) for effects in sets]
        changed = self.system.predict_cases(cases, points)
        changes = changed - self._base_prediction(points)
        of_channels = by_name(np.swapaxes(changes, 0, 1))
        compared = [of_channels[channel.name] for channel in self.channels]
        return np.stack(compared, axis=1)

    def meter_errors(self, points: Points, sound: Array) -> tuple[list[str], Array]:
        """Return names of errors of the meters, and what one deviation of each changes."""
        channels = [channel.name for channel in self.channels]
        errors = gauge_errors(channels)
        changes = np.zeros((len(errors), *sound.shape))
        for change, error in zip(changes, errors, strict=True):
            row = channels.index(error.channel)
            deviation = error.deviation / CLASS_TO_DRIFT
            change[row] = deviation * error.change_at(sound[row])
        return [error.name for error in errors], changes

    def candidates(self, points: Points) -> Points:
        """Return a grid of tests over the range of the campaign."""
        return self.system.candidates(points, self.base)

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond that of the sound transmission [W]."""
        return self.system.lost_power(points, expected, real)

    def model_of(
        self, effects: Sequence[Any], samples: Any, meters: Array | None = None
    ) -> EfficiencyModel:
        """Return the sound model with its changes; the remainder is no part of it."""
        if not effects:
            return self.model
        provenance = {**self.model.provenance, "baseline": self.source}
        return replace(
            self.model,
            effects=(*self.model.effects, *effects),
            domain=Domain.of(samples),
            provenance=provenance,
        )

    def growth_of(self, cause: Cause, samples: BenchSamples) -> Growth | None:
        """Return how much leakage or damping has grown, if a cause is that."""
        if cause.effect == LaminarLeakage.name:
            leakage = self.parameters["leakage"]
            relative_error = leakage.standard_error / leakage.value
            size = cause.parameters["leakage"]
            return Growth.of("leakage", cause, size, leakage.value, relative_error)
        if cause.effect == ViscousDamping.name:
            pump = self.parameters["pump_damping"]
            motor = self.parameters["motor_damping"]
            # The growth is that of either unit.
            total = pump.value + motor.value
            error = float(np.hypot(pump.standard_error, motor.standard_error))
            size = cause.parameters["damping"]
            return Growth.of("damping", cause, size, 0.5 * total, error / total)
        return None

    def answers(self, points: Points) -> NDArray[np.bool_]:
        """Return whether the sound model carries the load at each point, shape (n,)."""
        answered = np.isfinite(self._base_prediction(points)).all(axis=0)
        slopes = _slopes(self.system, self.base, points)
        return np.asarray(answered & np.isfinite(slopes).all(axis=(0, 2)))

    def remarks(self, samples: BenchSamples) -> tuple[str, ...]:
        """Return notes on what missing columns cost."""
        return self.system.remarks(samples)

    def _base_prediction(self, points: Points) -> Array:
        """Return the prediction of the model alone, which a search asks for repeatedly."""
        key = self.stacked(points).tobytes()
        if key not in self._predicted:
            self._predicted[key] = self.system.predict(self.base, (), points)
        return self._predicted[key]


def fit_sound_transmission(
    model: EfficiencyModel,
    observed: Observations,
    parameters: Mapping[str, ParameterEstimate],
    zeros: Mapping[str, float],
) -> SoundTransmission:
    """Fit what a model leaves of sound samples.

    Args:
        model: refitted to the sound samples.
        observed: the sound samples with the errors of their meters, in the channels that are
            compared.
        parameters: base parameters of the model with their standard errors.
        zeros: scales of the zeros of the torque meters.
    """
    observed = with_scaled_zeros(observed, zeros)
    system = Transmission(model, [channel.name for channel in observed.channels])
    base = scaled_base(system.base, model.parameters)
    predicted = system.predict(base, (), observed.points)
    slopes = _slopes(system, base, observed.points)
    answered = np.isfinite(predicted).all(axis=0) & np.isfinite(slopes).all(axis=(0, 2))
    index = np.flatnonzero(answered)
    observed = observed.select(index)
    points = stacked(observed.points, SOUND_AXES)
    spread = np.append(system.base.spread, np.ones(observed.shared_count))
    shared = observed.shared_columns * observed.deviation[..., None]
    channels = []
    remainders = []
    for i, channel in enumerate(observed.channels):
        row = system.channels.index(channel)
        columns = np.column_stack([slopes[row][index], shared[i]])
        scale = channel.misfit_spread
        if channel.relative:
            scale = scale * float(np.median(np.abs(observed.measured[i])))
        training = Training(
            points=points,
            columns=columns,
            spread=spread,
            values=observed.measured[i] - predicted[row][index],
            noise=observed.deviation[i],
            smooth_deviation=scale,
            nonnegative=np.zeros(len(spread), dtype=bool),
            min_width=min_widths(observed.points, SOUND_AXES, MIN_WIDTHS),
            order=np.arange(float(len(index))),
            noise_stated=not observed.assumed,
        )
        remainders.append(fit_remainder(training))
        channels.append(
            replace(channel, misfit_spread=channel.misfit_spread / CLASS_TO_DRIFT)
        )
    kinds: tuple[Any, ...] = (*WEAR, *shown_by(model, observed.points))
    return SoundTransmission(
        model=model,
        system=system,
        channels=tuple(channels),
        remainders=tuple(remainders),
        base=base,
        samples=observed.samples,
        library=tuple(kind() for kind in kinds),
        parameters=parameters,
        zeros=zeros,
    )


def observe_change(
    sound: SoundTransmission, samples: BenchSamples, noise: float | None
) -> Observations:
    """Set up the channels of samples, with the noise that the baseline shows.

    Args:
        sound: the baseline.
        samples: with the columns that are compared.
        noise: standard deviation of the efficiency [-], or None.
    """
    stages = list(sound.model.stages)
    observed = with_meter_errors(observe(samples, noise, stages), sound.system)
    observed = with_scaled_zeros(observed, sound.zeros)
    deviation = observed.deviation.copy()
    for i, remainder in enumerate(sound.remainders):
        ratio = remainder.noise_ratio_at(sound.stacked(observed.points))
        deviation[i] = sound.inflation * ratio * deviation[i]
    return replace(
        observed,
        channels=sound.channels,
        deviation=deviation,
        prior_dof=np.full(len(sound.channels), PRIOR_DOF_STATED),
        noise_source="scatter of the baseline",
        assumed=False,
    )


def _slopes(system: Transmission, base: Array, points: Points) -> Array:
    """Return derivatives of all channels by the base parameters, shape (channels, n, p)."""
    predicted = system.predict(base, (), points)
    columns = []
    for i, spread in enumerate(system.base.spread.tolist()):
        moved = base.copy()
        moved[i] += STEP * spread
        change = system.predict(moved, (), points) - predicted
        columns.append(change / (STEP * spread))
    return np.stack(columns, axis=-1)


def _padded(columns: Array, count: int) -> Array:
    """Return columns with zeros for the errors that only the sound readings share.

    Args:
        columns: derivatives by the base parameters, shape (n, p).
        count: number of columns of the fit.
    """
    further = np.zeros((len(columns), count - columns.shape[1]))
    return np.column_stack([columns, further])

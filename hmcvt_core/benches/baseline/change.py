# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A sound machine, held, as a `System` whose effects are changes since then.

The prediction is that of the sound machine, plus what the effects change, plus errors of the
meters. Only the errors of the meters are refitted: nothing else can absorb the signature of wear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from ...diagnosis.fitting.hypothesis import Hypothesis
from ...diagnosis.fitting.refit import Fit, refit
from ...diagnosis.observations import Observations
from ...diagnosis.results.outcome import Cause
from ...diagnosis.settings import FORM_ALLOWANCE, INVISIBLE_SIGNATURE
from ...diagnosis.system import (
    Array,
    Axis,
    BaseParameters,
    Case,
    Channel,
    Effect,
    Points,
    forms_of,
)
from .growth import Growth
from .remainder import LeftOut

VISIBLE_DIFFERENCE = 9.0
"""Squared deviations by which two curves must differ to be distinguished: three deviations."""
MAX_DIFFERENCE = 0.5
"""Largest part of a signature by which two curves may differ and count as one; half of it."""
NEGLIGIBLE_FRACTION = 0.3
"""Standard deviation of a direction of the sound prediction, in deviations of a reading, below
which it counts as independent noise. Its square is one percent of that of the reading."""
MAX_DIRECTIONS = 60
"""Maximum number of directions of uncertainty of one channel that are refitted.

The rest counts as noise.

Limit of computing time.
"""
CLASS_TO_DRIFT = 4.0
"""Errors within the class of a meter / its drift between two campaigns.

One meter has most of its error in both campaigns; assumed: a quarter changes between them. A
difference that another meter of the class would explain is no change.
"""
METER_BOUND = 3.0
"""Bound on errors of the meters, in their standard deviations."""


class SoundMachine(Protocol):
    """What a change is measured against.

    Attributes:
        axes: of an operating point.
        channels: read in both campaigns; the change is measured in the first.
        library: effects that may have changed, at size zero.
        refusal: as of a `System`.
        advice: as of a `System`.
        source: name of the file of the sound samples.
    """

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of an operating point."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels read in both campaigns."""

    @property
    def library(self) -> tuple[Any, ...]:
        """Effects that may have changed, at size zero."""

    @property
    def refusal(self) -> str:
        """As of a `System`."""

    @property
    def advice(self) -> str:
        """As of a `System`."""

    @property
    def source(self) -> str:
        """Name of the file of the sound samples."""

    def sound_at(self, points: Points) -> tuple[Array, Array]:
        """Return mean and covariance of the channels of the sound machine.

        Returns:
            Shapes (channels, n) and (channels, n, n).
        """

    def drift_at(self, points: Points, deviation: Array) -> Array:
        """Return the covariance of errors that readings in succession share.

        Args:
            points: operating points in the order of time.
            deviation: independent noise of the readings, shape (channels, n).

        Returns:
            Shape (channels, n, n).
        """

    def left_out_residuals(self) -> list[LeftOut]:
        """Return residuals of each channel at sound samples that are left out."""

    def changed_by_each(self, sets: Sequence[Sequence[Any]], points: Points) -> Array:
        """Return how each set of effects changes the channels, shape (sets, channels, n).

        Args:
            sets: at least one.
            points: operating points.
        """

    def meter_errors(self, points: Points, sound: Array) -> tuple[list[str], Array]:
        """Return names of errors of the meters, and what one deviation of each changes.

        Args:
            points: operating points.
            sound: readings of the sound machine at them, shape (channels, n).

        Returns:
            Names, and shape (errors, channels, n).
        """

    def candidates(self, points: Points) -> Points:
        """Return points at which a further test can be run."""

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond the expected loss [W], shape (n,)."""

    def model_of(
        self, effects: Sequence[Any], samples: Any, meters: Array | None = None
    ) -> Any:
        """Return the machine with its changes, as it is served."""

    def growth_of(self, cause: Cause, samples: Any) -> Growth | None:
        """Return how much a loss of the sound machine has grown, if a cause is its growth."""

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return notes on the samples."""


class Change:
    """A sound machine as a `System`; see `hmcvt_core.diagnosis.system`.

    Attributes:
        identified: number of base parameters that are to be identified: none.

    Args:
        machine: held.
        library: its effects that are different curves; all of them if None.
        meters: errors of the meters, in those of one meter between two campaigns.
    """

    identified = 0

    def __init__(
        self,
        machine: SoundMachine,
        library: tuple[Any, ...] | None = None,
        meters: float = 1.0,
    ) -> None:
        self.machine = machine
        self.meters = meters
        self.axes = machine.axes
        self.channels = machine.channels
        self.library: tuple[Effect, ...] = (
            machine.library if library is None else library
        )
        self.refusal = machine.refusal
        self.advice = machine.advice
        self._sound: dict[bytes, Array] = {}
        self.base = self._base_parameters()

    def _base_parameters(self) -> BaseParameters:
        """Errors of the meters, in standard deviations."""
        one = {axis.name: np.ones(1) for axis in self.axes}
        names, _ = self.machine.meter_errors(one, np.ones((len(self.channels), 1)))
        ones = np.ones(len(names))
        return BaseParameters(
            names=tuple(names),
            mean=0.0 * ones,
            spread=ones,
            low=-METER_BOUND * ones,
            high=METER_BOUND * ones,
            values=partial(np.array, dtype=float),
            units=("times the expected drift",) * len(names),
        )

    def sound_mean(self, points: Points) -> Array:
        """Return the readings of the sound machine, shape (channels, n)."""
        rows = [points[axis.name] for axis in self.axes if axis.name in points]
        key = np.stack(np.broadcast_arrays(*rows)).tobytes()
        if key not in self._sound:
            self._sound[key], _ = self.machine.sound_at(points)
        return self._sound[key]

    def predict(self, base: Array, effects: Sequence[Any], points: Points) -> Array:
        """Return the readings of the changed machine, shape (channels, n).

        Args:
            base: errors of the meters, in standard deviations, shape (p,).
            effects: changes, at their sizes.
            points: operating points.
        """
        return np.asarray(self.predict_cases([(base, effects)], points)[0])

    def predict_cases(self, cases: Sequence[Case], points: Points) -> Array:
        """Return the readings of many cases, as `predict` those of one; (cases, channels, n)."""
        sound = self.sound_mean(points)
        _, errors = self.machine.meter_errors(points, sound)
        bases = np.stack([base for base, _ in cases])
        predicted = sound + self.meters * np.tensordot(bases, errors, axes=1)
        changed = [i for i, (_, effects) in enumerate(cases) if effects]
        if changed:
            sets = [cases[i][1] for i in changed]
            predicted[changed] += self.machine.changed_by_each(sets, points)
        return np.asarray(predicted)

    def candidates(self, points: Points, base: Array) -> Points:
        """Return points at which a further test can be run."""
        return self.machine.candidates(points)

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond that of the sound machine [W]."""
        return self.machine.lost_power(points, expected, real)

    def model_of(
        self, base: Array, effects: Sequence[Any], samples: Any, covariance: Array
    ) -> Any:
        """Return the machine with its changes."""
        return self.machine.model_of(effects, samples, base)

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return notes on the samples."""
        return self.machine.remarks(samples)


def with_sound_uncertainty(
    observed: Observations, machine: SoundMachine
) -> Observations:
    """Return readings that share the uncertainty of the sound machine, and the drift of the bench.

    The covariance at the readings is split into directions, which are refitted with unit priors,
    and a rest that is added to the noise of each reading.

    Args:
        observed: readings of the changed machine.
        machine: against which they are compared.
    """
    _, covariance = machine.sound_at(observed.points)
    covariance = covariance + machine.drift_at(observed.points, observed.deviation)
    channels, n = observed.measured.shape
    columns = []
    deviation = observed.deviation.copy()
    for i in range(channels):
        directions = _directions(covariance[i], observed.deviation[i])
        explained = np.sum(directions**2, axis=1)
        rest = np.maximum(np.diagonal(covariance[i]) - explained, 0.0)
        deviation[i] = np.sqrt(deviation[i] ** 2 + rest)
        of_channel = np.zeros((channels, n, directions.shape[1]))
        of_channel[i] = directions
        columns.append(of_channel)
    shared = np.concatenate(columns, axis=-1)
    if observed.shared_errors is not None:
        shared = np.concatenate([observed.shared_errors, shared], axis=-1)
    return replace(
        observed,
        deviation=deviation,
        shared_errors=shared if shared.shape[-1] else None,
    )


def _directions(covariance: Array, deviation: Array) -> Array:
    """Return the main directions of a covariance, in the unit of the channel, shape (n, m).

    Args:
        covariance: of the sound prediction, shape (n, n).
        deviation: of the readings, shape (n,).
    """
    scaled = covariance / np.outer(deviation, deviation)
    values, vectors = np.linalg.eigh(scaled)
    # A direction counts by the squared deviations that it makes in all readings together.
    kept = np.flatnonzero(values > NEGLIGIBLE_FRACTION**2)[-MAX_DIRECTIONS:]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]) * deviation[:, None])


# --- effects that are the same curve --------------------------------------------------------


def different_curves(
    machine: SoundMachine, observed: Observations
) -> dict[str, tuple[Any, ...]]:
    """Return the effects whose curves can be distinguished on some tests.

    Two curves are one where they differ by less than the noise hides, or in no channel by more than
    the forms of effects are exact. A form error is one factor for all channels, so that a channel
    in which only one of them shows distinguishes them.

    Args:
        machine: held; the order of its library decides which effect stands for others.
        observed: the tests.

    Returns:
        By the name of each effect that is compared the effects that are the same curve, itself
        first, one class of each name. Effects that the readings do not show are left out.
    """
    system = Change(machine)
    hypothesis = Hypothesis(system, shared_count=observed.shared_count)
    base = refit(hypothesis, observed)
    # Of the noise only the statement is free of the change.
    base = replace(base, noise=np.ones_like(base.noise))
    classes: dict[str, Any] = {}
    curves: dict[str, Array] = {}
    for effect in machine.library:
        of_forms = _visible_curves(base, effect)
        if not len(of_forms):
            continue
        classes.setdefault(effect.name, effect)
        if effect.name in curves:
            of_forms = np.concatenate([curves[effect.name], of_forms])
        curves[effect.name] = of_forms
    visible = _visible_difference(base, curves)
    kept: dict[str, list[Any]] = {}
    for name, effect in classes.items():
        same = (
            other
            for other in kept
            if _is_same(base, curves[name], curves[other], visible)
        )
        kept.setdefault(next(same, name), []).append(effect)
    return {name: tuple(effects) for name, effects in kept.items()}


def _visible_curves(base: Fit, effect: Any) -> Array:
    """Return what the meters leave of the forms of an effect, unit vectors, shape (forms, m)."""
    curves = []
    for form in forms_of(effect):
        signature = base.signature(form)
        if np.abs(signature).max() < INVISIBLE_SIGNATURE:
            continue
        left = base.project_out(signature[None])[0]
        length = float(np.linalg.norm(left))
        if length > 0.0:
            curves.append(left / length)
    return np.array(curves)


def _visible_difference(base: Fit, curves: Mapping[str, Array]) -> float:
    """Return the smallest squared difference of two curves that the noise does not hide.

    Args:
        base: the refit without a change.
        curves: unit vectors of each effect, shape (forms, m).
    """
    residuals = base.project_out(base.whitened[None])[0]
    largest = VISIBLE_DIFFERENCE / MAX_DIFFERENCE
    for of_forms in curves.values():
        largest = max(largest, float(np.max((of_forms @ residuals) ** 2)))
    return VISIBLE_DIFFERENCE / largest


def _is_same(base: Fit, curves: Array, others: Array, visible: float) -> bool:
    """Return whether every form of one effect is the curve of a form of another.

    Args:
        base: the refit without a change.
        curves: unit vectors of the forms of one effect, shape (forms, m).
        others: the same of the other effect.
        visible: smallest squared difference that counts.
    """
    cosines = curves @ others.T
    for curve, row in zip(curves, cosines, strict=True):
        nearest = int(np.abs(row).argmax())
        difference = curve - row[nearest] * others[nearest]
        if _beyond_form_errors(base, curve, difference) >= visible:
            return False
    return True


def _beyond_form_errors(base: Fit, curve: Array, difference: Array) -> float:
    """Return the squared difference in the channels in which it is more than a form error.

    Args:
        base: the refit without a change.
        curve: rows of `Fit.project_out`, shape (m,).
        difference: from another curve, the same rows.
    """
    observed = base.observed
    count = len(observed.channels) * len(observed)
    of_curve = curve[:count].reshape(len(observed.channels), -1)
    of_difference = difference[:count].reshape(of_curve.shape)
    spreads = [max(FORM_ALLOWANCE, item.change_spread) for item in observed.channels]
    squares = np.sum(of_difference**2, axis=1)
    allowed = np.square(spreads) * np.sum(of_curve**2, axis=1)
    return float(np.sum(squares[squares > allowed]))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the diagnosis has to know of a system on a bench.

A system predicts channels at operating points from a few base parameters, which have priors, and
from effects that its model leaves out. `hmcvt_core.benches` implements the protocol for a
transmission and for a hydrostatic unit.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Points = Mapping[str, Array]
"""Operating points: values of shape (n,) by the name of the axis."""
FIELD_SPREADS = (2.5, 8.0, 25.0)
"""Prior standard deviations of a smooth unlisted loss, in deviations of the meter.

In the same proportion to the meter as for the efficiency of a transmission.
"""
STEP_SPREADS = (8.0, 25.0)
"""The same of an unlisted loss inside a region."""


@dataclass(frozen=True)
class Axis:
    """One coordinate of an operating point.

    Attributes:
        name: as in files.
        unit: as in files; `-` for a plain number.
        word: its name in a sentence.
        heading: the heading of a column of its limits.
        digits: decimals of a printed limit.
        tolerance: how closely a bench sets it, whatever the range of the campaign, in its unit.
        graded: whether a sentence calls it low or high; otherwise the sentence gives the limits.
        steered: whether a test can set it. If not it is only recorded: regions and tests do not
            depend on it.
        labels: names of the values 0, 1, ... of an axis that is only recorded; a test names the
            value by its label.
        test_format: format of a value in the description of a test; `{0}` is the value, `{1}` the
            value times `second_unit_factor`.
        second_unit_factor: from the unit to a second one.
        transition_width: half-width around a point within which the machine may change from one
            operating mode to another, in its unit. Auxiliary readings so close to a transition
            are known only as well as the modes agree.
    """

    name: str
    unit: str
    word: str
    heading: str
    digits: int
    tolerance: float
    graded: bool = True
    steered: bool = True
    labels: tuple[str, ...] = ()
    test_format: str = "{0:g}"
    second_unit_factor: float = 1.0
    transition_width: float = 0.0

    @classmethod
    def of(cls, name: str, unit: str = "-", *, digits: int = 2) -> Axis:
        """Return an axis that a test can set, worded by its name.

        Args:
            name: of the column.
            unit: of its values; `-` for a plain number.
            digits: decimals of a printed limit; half of the last one is the tolerance.
        """
        word = name.replace("_", " ")
        return cls(
            name=name,
            unit=unit,
            word=word,
            heading=f"{word} [{unit}]",
            digits=digits,
            tolerance=0.5 * 10.0**-digits,
            test_format=f"{{0:.{digits}f}} {unit}".removesuffix(" -"),
        )


@dataclass(frozen=True)
class Channel:
    """One quantity that the model predicts and the bench may read.

    Attributes:
        name: as in files.
        unit: in which it is printed.
        factor: from the value to the printed number.
        digits: decimals of the printed number.
        uncertainty: standard deviation assumed where none is stated, as a part of the reading.
            Zero means that it is propagated from meters and stays as stated by `least`.
        relative: whether a discrepancy in it counts as a part of the reading. The first channel
            then changes by the same part.
        field_spreads: prior standard deviations of a discrepancy that is smooth over the axes,
            equally likely; in the channel's unit, or relative.
        step_spreads: the same for a discrepancy inside a region.
        misfit_spread: the same for the smooth discrepancy of a base model that is a little off.
        least: standard deviation assumed at a reading of zero, in the channel's unit.
        served: whether users take this channel from the model. The others, auxiliary channels,
            only help to find the cause.
        change_spread: prior standard deviation of the factor by which this channel shows a change
            otherwise than predicted [-], as where it reads an unknown part of a leak.
    """

    name: str
    unit: str
    factor: float
    digits: int
    uncertainty: float
    relative: bool
    field_spreads: tuple[float, ...]
    step_spreads: tuple[float, ...]
    misfit_spread: float
    least: float = 0.0
    served: bool = True
    change_spread: float = 0.0

    @classmethod
    def of(
        cls,
        name: str,
        unit: str,
        noise: float,
        *,
        digits: int = 4,
        served: bool = True,
    ) -> Channel:
        """Return a channel whose priors are in proportion to the noise of its meter.

        Args:
            name: of the column.
            unit: of its values; `-` for a fraction, which is printed in points of 1 %.
            noise: standard deviation of a reading.
            digits: decimals of a value in its unit.
            served: whether the channel is what the model is for.
        """
        is_fraction = unit == "-"
        return cls(
            name=name,
            unit="points" if is_fraction else unit,
            factor=100.0 if is_fraction else 1.0,
            digits=max(digits - 2, 0) if is_fraction else digits,
            uncertainty=0.0,
            relative=False,
            field_spreads=tuple(noise * spread for spread in FIELD_SPREADS),
            step_spreads=tuple(noise * spread for spread in STEP_SPREADS),
            misfit_spread=noise,
            least=noise,
            served=served,
        )

    def deviation(self, reading: Array) -> Array:
        """Return the standard deviation assumed for readings, same shape and unit."""
        return np.hypot(self.uncertainty * reading, self.least)


@dataclass(frozen=True, eq=False)
class Unrecorded:
    """A quantity that may vary although nothing records it.

    Attributes:
        name: in words; those of the column, where a bench can record it.
        sensor: what to record to see it, in words.
        change: of every reading by a change of the quantity, in the units of the channels, shape
            (channels, n).
    """

    name: str
    sensor: str
    change: Array


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The parameters that every hypothesis refits, in scaled variables of shape (p,).

    Attributes:
        names: of the parameters.
        mean: prior mean of the scaled variables.
        spread: prior standard deviations of the scaled variables.
        low: hard lower bounds of the scaled variables.
        high: hard upper bounds of the scaled variables.
        values: returns the parameters in their units for scaled variables.
        units: of the parameters, for reports; empty where none is stated.
    """

    names: tuple[str, ...]
    mean: Array
    spread: Array
    low: Array
    high: Array
    values: Callable[[Array], Array]
    units: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.names)


class Effect(Protocol):
    """A physical effect that the base model leaves out.

    `hmcvt_core.physics.effects` documents each member. `parameters` and `sizes` return objects
    with `name`, `unit`, `meaning`, `typical`, `low`, `high`, `grid` (the values tried of a shape,
    empty for a size), `is_size` and `bends` (a shape that may take any value within its range).
    Of several sizes the first is fitted. An attribute `varied` may name base parameters, in
    proportion to their scaled variables, that differ from point to point where the effect acts. An
    attribute `shared_error` may name the error of a meter that the effect is a larger value of. An
    attribute `condition` may name, of an effect that is a condition of the test and no damage, the
    condition at which it is off.
    """

    name: ClassVar[str]
    form: ClassVar[str]
    component: ClassVar[str]
    summary: ClassVar[str]
    source: ClassVar[str]
    remedy: ClassVar[str]

    def parameters(self) -> Sequence[Any]:
        """Return the declared parameters."""

    def sizes(self) -> Sequence[Any]:
        """Return the parameters whose zero switches the effect off."""

    def values(self) -> dict[str, float]:
        """Return parameter values by name."""

    def with_values(self, values: dict[str, float]) -> Effect:
        """Return a copy with other parameter values."""


class System(Protocol):
    """A model on a bench.

    Attributes:
        axes: of an operating point, in the order in which they are printed.
        channels: all that can be read; the gap is measured in the first.
        base: the base parameters, and nuisance parameters known within a tolerance only.
        library: candidate effects, one of each form, at size zero.
        refusal: predicate of a sentence about samples for which the model has no answer.
        advice: what to check about such samples.
    """

    axes: tuple[Axis, ...]
    channels: tuple[Channel, ...]
    base: BaseParameters
    library: tuple[Effect, ...]
    refusal: str
    advice: str

    def predict(self, base: Array, effects: Sequence[Effect], points: Points) -> Array:
        """Return every channel as the bench reads it; NaN where the model has no answer.

        Args:
            base: scaled base parameters, shape (p,).
            effects: added to the base model.
            points: operating points.

        Returns:
            Shape (channels, n), each channel in its unit.
        """

    def candidates(self, points: Points, base: Array) -> Points:
        """Return points at which a further test can be run.

        Args:
            points: measured so far.
            base: scaled base parameters, shape (p,).
        """

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond the expected loss [W], shape (n,).

        Args:
            points: operating points.
            expected: the first channel without the additional loss, shape (n,).
            real: the first channel with it, shape (n,).
        """

    def model_of(
        self, base: Array, effects: Sequence[Effect], samples: Any, covariance: Array
    ) -> Any:
        """Return the model that is saved and served for a hypothesis fitted to samples.

        Args:
            base: scaled base parameters, shape (p,).
            effects: at their fitted sizes.
            samples: the record to which they were fitted.
            covariance: of the scaled base parameters, shape (p, p).
        """

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return notes on the samples that hold whatever the diagnosis finds."""


Case = tuple[Array, Sequence[Effect]]
"""Scaled base parameters, shape (p,), and the effects added to the base model."""


@runtime_checkable
class PredictsCases(Protocol):
    """A `System` that predicts many cases together faster than one after another."""

    def predict_cases(self, cases: Sequence[Case], points: Points) -> Array:
        """Return what `System.predict` returns of each case, shape (cases, channels, n)."""


def predict_cases(system: System, cases: Sequence[Case], points: Points) -> Array:
    """Return the predictions of many cases, shape (cases, channels, n).

    Args:
        system: on the bench.
        cases: at least one.
        points: operating points.
    """
    if isinstance(system, PredictsCases):
        return system.predict_cases(cases, points)
    predicted = [system.predict(base, effects, points) for base, effects in cases]
    return np.stack(predicted)


def forms_of(effect: Effect) -> list[Effect]:
    """Return one instance for each combination of the values tried of an effect's shapes."""
    grids = {item.name: item.grid for item in effect.parameters() if not item.is_size}
    forms = []
    for values in itertools.product(*grids.values()):
        shapes = dict(zip(grids, values, strict=True))
        forms.append(effect.with_values(shapes))
    return forms

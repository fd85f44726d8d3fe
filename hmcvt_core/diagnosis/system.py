# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the diagnosis asks of whatever stands on a bench: all that it knows of it.

A system predicts channels at operating points from a few base parameters with priors, and from
effects that its model leaves out. `hmcvt_core.benches` holds the systems that there are.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Points = Mapping[str, Array]
"""Operating points: values of shape (n,) by the name of the axis."""


@dataclass(frozen=True)
class Axis:
    """One quantity that makes an operating point.

    Attributes:
        name, unit: as in files; the unit is `-` for a plain number.
        word: what it is called in a sentence.
        heading: over a column of its limits, which are printed with `digits` decimals.
        held: how closely a bench holds it, whatever the range of the campaign, in its unit.
        graded: whether a sentence calls it low or high; else it gives the limits.
        steered: whether a test can ask for a value; else it is only recorded, and neither regions
            nor tests are looked for along it.
        labels: names of the values 0, 1, ... of an axis that is only recorded; a test names its.
        told: form of a value in the description of a test; `{0}` is the value, `{1}` the same in
            another unit, `second` times as large.
        turns: how far from where the model has it a machine may turn from one way of working to
            another; readings as near as that are known no better than by half of what lies between.
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


@dataclass(frozen=True)
class Channel:
    """One quantity that the model predicts and the bench may read.

    Attributes:
        name: as in files.
        unit: in which it is told, `factor` times the value with so many decimals.
        uncertainty: standard deviation taken until somebody states it or the data tell: a part of
            the reading, and `least` besides.
        relative: whether an unlisted loss in it counts as a part of the reading, and is the same
            part lost of the first channel.
        field_spreads: prior standard deviations of such a loss that varies smoothly over the axes,
            equally likely; in the channel's unit, or relative.
        step_spreads: the same for one inside a region.
        misfit_spread: the same for a smooth misfit of the base model that is no cause.
        least: standard deviation of a reading of zero, in the channel's unit.
        served: whether the model is there to foretell it; others help to find what is lost.
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

    def deviation(self, reading: Array) -> Array:
        """Standard deviation of readings that nobody states, same shape."""
        return np.hypot(self.uncertainty * reading, self.least)


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """The parameters that every hypothesis refits, in scaled variables of shape (p,).

    Attributes:
        names: of the parameters.
        mean, spread: of the scaled variables before any bench.
        low, high: their hard bounds.
        values: gives the parameters in their units for scaled variables.
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
    """Something the base model leaves out; `hmcvt_core.physics.effects` says what each member is.

    `parameters` and `sizes` give objects with `name`, `unit`, `meaning`, `typical`, `low`, `high`,
    `grid` (the values tried of a shape, empty for a size), `is_size` and `bends` (a shape that may
    have any value between); of several sizes the first is fitted.
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
        axes: of an operating point, in the order in which they are told.
        channels: all that can be read, the one in which the gap is measured first.
        base: the base parameters, with what no bench knows better than within a tolerance.
        library: effects that may be missing, one of each form, at size zero.
        refusal: what samples ask for at which the model has no answer; `advice` what to check.
    """

    axes: tuple[Axis, ...]
    channels: tuple[Channel, ...]
    base: BaseParameters
    library: tuple[Effect, ...]
    refusal: str
    advice: str

    def predict(self, base: Array, effects: Sequence[Effect], points: Points) -> Array:
        """Return every channel as the bench reads it, (channels, n); NaN: no answer."""

    def candidates(self, points: Points, base: Array) -> Points:
        """Return points at which a further test can be run, given those measured so far."""

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power that is lost at points beyond what is expected [W], (n,).

        Args:
            points: where.
            expected, real: the first channel, shape (n,).
        """

    def model_of(
        self, base: Array, effects: Sequence[Effect], samples: Any, covariance: Array
    ) -> Any:
        """Return what is saved and served of a hypothesis fitted to samples.

        Args:
            base: scaled base parameters, shape (p,).
            effects: at their fitted sizes.
            samples: the record to which they were fitted.
            covariance: of the scaled base parameters, shape (p, p).
        """

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return what to say of samples whatever the diagnosis finds."""


def forms_of(effect: Effect) -> list[Effect]:
    """Return one instance for each combination of the values tried of an effect's shapes."""
    shapes = {item.name: item.grid for item in effect.parameters() if not item.is_size}
    return [
        effect.with_values(dict(zip(shapes, values, strict=True)))
        for values in itertools.product(*shapes.values())
    ]

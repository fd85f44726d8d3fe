# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Any simulator as a `System`: a function whose arguments switch effects on.

    def simulate(points, *, inertia, friction, backlash):
        return {"amplitude": ...}

    JOINT = Simulator(simulate, axes, channels, parameters, effects)

`parameters` are fitted to every campaign; each of `effects` is a `Switch`, whose value 0 switches
it off, or a `SystemEffect`, whose fields are arguments of the function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..diagnosis.system import Array, Axis, BaseParameters, Channel, Points
from ..errors import InputError
from ..physics.effects.base import EffectParameter

Simulation = Callable[..., Mapping[str, ArrayLike]]
"""Function of points and keyword arguments that returns the channels by name, shape (n,) each."""
LostPower = Callable[[Points, Array, Array], Array]
"""Function of points, expected and real first channel that returns a power [W], shape (n,)."""
MAX_CANDIDATES = 64
"""Points that a next test is chosen from: about as many as the grid of a transmission has."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of a simulator that is fitted to every campaign.

    Attributes:
        name: of the argument of the function.
        unit: for reports.
        mean: expected value.
        spread: standard deviation of what is known of it before the tests.
        low: least value that the function accepts.
        high: largest value that the function accepts.
    """

    name: str
    unit: str
    mean: float
    spread: float
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        if not self.spread > 0.0:
            raise InputError(f"parameter {self.name}: spread {self.spread} is not > 0")
        if not self.low <= self.mean <= self.high:
            raise InputError(
                f"parameter {self.name}: mean {self.mean} is not within {self.low} to {self.high}"
            )


@dataclass(frozen=True)
class Switch:
    """An effect that one argument of a simulator switches on.

    Attributes:
        name: of the effect, and of the argument; 0 switches it off.
        unit: of the argument.
        typical: size expected where the effect matters; scale of its prior.
        low: least plausible size; below 0 where both signs are possible.
        high: largest plausible size.
        summary: what the effect does, in plain words; its name where left out.
        component: the part that it belongs to; `sensor` for an error of the bench.
        remedy: the measurement that settles it when no operating point can; may be empty.
        source: where its form comes from.
        value: its size now.
    """

    name: str
    unit: str
    typical: float
    low: float
    high: float
    summary: str = ""
    component: str = "machine"
    remedy: str = ""
    source: str = ""
    value: float = 0.0

    form = ""

    def __post_init__(self) -> None:
        if self.typical == 0.0 or not self.low <= self.typical <= self.high:
            raise InputError(
                f"effect {self.name}: typical size {self.typical} is 0 or not within "
                f"{self.low} to {self.high}"
            )
        if not self.summary:
            object.__setattr__(self, "summary", self.name.replace("_", " "))
        if not self.low <= 0.0 <= self.high:
            raise InputError(
                f"effect {self.name}: {self.low} to {self.high} does not hold 0, which "
                "switches it off"
            )

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Return the declared parameters: the size."""
        size = EffectParameter(
            self.name, self.unit, self.summary, self.typical, self.low, self.high
        )
        return (size,)

    def sizes(self) -> tuple[EffectParameter, ...]:
        """Return the parameters whose zero switches the effect off."""
        return self.parameters()

    def values(self) -> dict[str, float]:
        """Return parameter values by name."""
        return {self.name: self.value}

    def with_values(self, values: Mapping[str, float]) -> Switch:
        """Return a copy with another size."""
        return replace(self, value=float(values.get(self.name, self.value)))


@dataclass(frozen=True, eq=False)
class Simulator:
    """A simulator as a `System` of `diagnose_system`.

    Attributes:
        function: called as `function(points, **arguments)` with every parameter, and every
            argument of every effect, at its value; returns each channel by name, shape (n,), NaN
            where there is no answer.
        axes: of an operating point.
        channels: what the bench may read; the gap is measured in the first.
        parameters: fitted to every campaign.
        effects: candidates, at size zero: `Switch` or `SystemEffect`.
        power: returns the power lost beyond the expected one, from points, expected and real
            first channel; None where the first channel states no power.
        tests: operating points at which a further test is possible; None for points spread over
            the range of the campaign.
        refusal: predicate of a sentence about samples for which the function has no answer.
        advice: what to check about such samples.
    """

    function: Simulation
    axes: tuple[Axis, ...]
    channels: tuple[Channel, ...]
    parameters: tuple[Parameter, ...]
    effects: tuple[Any, ...]
    power: LostPower | None = None
    tests: Points | None = None
    refusal: str = "are points at which the simulator has no answer"
    advice: str = "check the units of the columns"

    def __post_init__(self) -> None:
        for name in ("axes", "channels", "parameters", "effects"):
            values = tuple(getattr(self, name))
            if not values:
                raise InputError(f"simulator: {name} is empty")
            object.__setattr__(self, name, values)
        arguments = [item.name for item in self.parameters]
        for effect in {item.name: item for item in self.effects}.values():
            arguments += effect.values()
        doubled = {name for name in arguments if arguments.count(name) > 1}
        if doubled:
            raise InputError(
                f"simulator: argument {min(doubled)} belongs to two parameters or effects"
            )

    @property
    def library(self) -> tuple[Any, ...]:
        """Candidate effects at size zero."""
        return self.effects

    @property
    def base(self) -> BaseParameters:
        """Parameters in spreads from their means."""
        mean = np.array([item.mean for item in self.parameters])
        spread = np.array([item.spread for item in self.parameters])
        low = np.array([item.low for item in self.parameters])
        high = np.array([item.high for item in self.parameters])
        return BaseParameters(
            names=tuple(item.name for item in self.parameters),
            mean=np.zeros(len(mean)),
            spread=np.ones(len(mean)),
            low=(low - mean) / spread,
            high=(high - mean) / spread,
            values=self._values,
            units=tuple(item.unit for item in self.parameters),
        )

    def _values(self, scaled: Array) -> Array:
        """Return the parameters in their units, shape (p,)."""
        mean = np.array([item.mean for item in self.parameters])
        spread = np.array([item.spread for item in self.parameters])
        return np.asarray(mean + spread * scaled)

    def predict(self, base: Array, effects: Sequence[Any], points: Points) -> Array:
        """Return every channel at operating points, shape (channels, n).

        Args:
            base: scaled parameters, shape (p,).
            effects: switched on.
            points: operating points.

        Raises:
            InputError: the function returns no such channel, or another shape.
        """
        arguments: dict[str, float] = {}
        for effect in self.effects:
            arguments.update(effect.values())
        for item, value in zip(self.parameters, self._values(base), strict=True):
            arguments[item.name] = float(value)
        for effect in effects:
            arguments.update(effect.values())
        return self.run(points, **arguments)

    def run(self, points: Points, **arguments: float) -> Array:
        """Call the function and return its channels, shape (channels, n).

        Args:
            points: operating points.
            arguments: of parameters and effects, by name.

        Raises:
            InputError: the function returns no such channel, or another shape.
        """
        shape = np.shape(points[self.axes[0].name])
        answer = self.function(points, **arguments)
        rows = []
        for channel in self.channels:
            if channel.name not in answer:
                raise InputError(f"the simulator returns no channel {channel.name}")
            row = np.asarray(answer[channel.name], dtype=float)
            if row.shape != shape:
                raise InputError(
                    f"the simulator returns {channel.name} of shape {row.shape}, not {shape}"
                )
            rows.append(np.where(np.isfinite(row), row, np.nan))
        return np.stack(rows)

    def candidates(self, points: Points, base: Array) -> Points:
        """Return the points that a test can ask for."""
        from scipy.stats import qmc

        if self.tests is not None:
            return self.tests
        steered = [axis for axis in self.axes if axis.steered]
        unit = qmc.Halton(len(steered), scramble=False).random(MAX_CANDIDATES)
        chosen: dict[str, Array] = {}
        for axis, fraction in zip(steered, unit.T, strict=True):
            measured = points[axis.name]
            chosen[axis.name] = measured.min() + fraction * np.ptp(measured)
        for axis in self.axes:
            if axis.name in points and not axis.steered:
                middle = float(np.median(points[axis.name]))
                chosen[axis.name] = np.full(MAX_CANDIDATES, middle)
        return chosen

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond the expected one [W], (n,); NaN where none is stated."""
        if self.power is None:
            return np.full(np.shape(real), np.nan)
        return np.asarray(self.power(points, expected, real), dtype=float)

    def model_of(
        self, base: Array, effects: Sequence[Any], samples: Any, covariance: Array
    ) -> dict[str, Any]:
        """Return the arguments of the fitted simulator, and the covariance of its parameters."""
        arguments: dict[str, Any] = dict(
            zip(
                (item.name for item in self.parameters), self._values(base), strict=True
            )
        )
        for effect in effects:
            arguments.update(effect.values())
        return {"arguments": arguments, "covariance": covariance}

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return notes on the samples: none."""
        return ()

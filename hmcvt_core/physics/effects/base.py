# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Base class of effects. A subclass overrides the hooks it changes.

Its dataclass fields, declared with `size` and `shape`, are its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

Array = NDArray[np.float64]
Value = Array | float
PRESSURE_REFERENCE = 20e6
"""Pressure at which sizes are stated [Pa]."""
OIL_HOOKS = "viscosity_ratio", "film_viscosity_ratio"
_OF_ANY_SIZE = ("-", "1/GPa", "K")
"""Units of sizes that are the same in small pumps and in large ones."""


class ShaftState(NamedTuple):
    """Speeds, pressure and load at operating points; arrays of one shape (..., n), SI units.

    They may be views: make new ones instead of changing them.

    Attributes:
        engine_speed, pump_speed, output_speed: [rad/s], positive.
        motor_speed: [rad/s], positive where the hydraulic path adds to the output speed.
        displacement_ratio: the true one [-], in the sense of `motor_speed`.
        pressure: pressure difference over the motor [Pa].
        viscosity_ratio: viscosity of the oil / viscosity at identification [-].
        sun_speed: sun against carrier [rad/s].
        sun_torque: that the load asks of the sun of a lossless row [N m], positive.
        load_power: output power [W].
        displacement: V_p = V_m of the larger unit, for forms that scale with size [m3/rad].
        open_clutches: slip of each per engine speed and per output speed [-], as the data of the
            stage say; without data one that slips as the output turns.
        pump_per_motor: V_p / V_m [-].
        oil_temperature: [deg C]; None where it is not known.
        commanded_ratio: displacement ratio as bench files state it [-]; None for a single unit.
    """

    engine_speed: Array
    pump_speed: Array
    output_speed: Array
    motor_speed: Array
    displacement_ratio: Array
    pressure: Array
    viscosity_ratio: Value
    sun_speed: Array
    sun_torque: Array
    load_power: Array
    displacement: float
    open_clutches: Sequence[tuple[float, float]] = ((0.0, 1.0),)
    pump_per_motor: float = 1.0
    oil_temperature: Array | None = None
    commanded_ratio: Array | None = None

    @property
    def delivered_speed(self) -> Array:
        """Motor speed that the whole flow of the pump gives [rad/s], as eq. (13) has it."""
        return self.pump_per_motor * self.displacement_ratio * self.pump_speed


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes:
        name, unit, meaning: for reports.
        typical: the size expected where the effect matters; scale of its prior.
        low, high: bounds of what is physically plausible.
        grid: for a shape: the values tried. Empty for a size.
        between: whether a shape may have other values than those of its grid, too.
    """

    name: str
    unit: str
    meaning: str
    typical: float
    low: float
    high: float
    grid: tuple[float, ...] = ()
    between: bool = True

    @property
    def bends(self) -> bool:
        """Whether it is a shape that may have any value between its bounds."""
        return bool(self.grid) and self.between and self.high > self.low

    @property
    def within_grid(self) -> bool:
        """Whether a refit keeps a shape between the ends of its grid."""
        return (self.low, self.high) == (min(self.grid), max(self.grid))

    @property
    def is_size(self) -> bool:
        """Whether zero switches the effect off."""
        return not self.grid

    @property
    def grows(self) -> bool:
        """Whether it is a size that grows with the displacement of pump or motor."""
        return self.is_size and self.unit not in _OF_ANY_SIZE

    def times(self, factor: float) -> EffectParameter:
        """Return the parameter in a unit so many times as large."""
        if not self.grows:
            return self
        return replace(
            self,
            typical=factor * self.typical,
            low=factor * self.low,
            high=factor * self.high,
        )


def size(unit: str, typical: float, low: float, high: float, meaning: str) -> Any:
    """Declare a parameter whose zero switches the effect off."""
    return field(
        default=0.0,
        metadata={
            "unit": unit,
            "meaning": meaning,
            "typical": typical,
            "low": low,
            "high": high,
        },
    )


def shape(
    unit: str,
    grid: tuple[float, ...],
    meaning: str,
    between: bool = True,
    limits: tuple[float, float] | None = None,
) -> Any:
    """Declare a parameter that bends the form; `grid[len(grid) // 2]` is its default.

    With `between` the leading sets are refitted with it anywhere between its limits; not where all
    of the grid are whole numbers (int), which are a switch or an index.

    Args:
        unit: for reports.
        grid: values tried first, ascending.
        meaning: for reports.
        between: whether a refit may leave the grid.
        limits: of a refit; the ends of the grid if None. Wider ones cost no further form.
    """
    typical = grid[len(grid) // 2]
    low, high = limits or (min(grid), max(grid))
    return field(
        default=typical,
        metadata={
            "unit": unit,
            "meaning": meaning,
            "typical": typical,
            "low": low,
            "high": high,
            "grid": grid,
            "between": between and not all(isinstance(value, int) for value in grid),
        },
    )


def ramp(excess: Array, width: float) -> Array:
    """Return max(excess, 0), rounded off within `width` on either side of zero.

    A steady state is sought along slopes, which a corner misleads.
    """
    rounded = np.square(np.maximum(excess + width, 0.0)) / (4.0 * width)
    return np.asarray(np.where(excess < width, rounded, excess))


_Kind = TypeVar("_Kind", bound="Parametrised")


@dataclass(frozen=True)
class Parametrised:
    """Base of what has parameters that are declared with `size` and `shape`."""

    _declared: ClassVar[tuple[EffectParameter, ...]]

    @classmethod
    def parameters(cls) -> tuple[EffectParameter, ...]:
        """Return the declared parameters."""
        # A diagnosis asks for them at each of thousands of predictions.
        if "_declared" not in cls.__dict__:
            cls._declared = tuple(
                EffectParameter(item.name, **item.metadata)
                for item in fields(cls)
                if item.metadata
            )
        return cls._declared

    @classmethod
    def sizes(cls) -> tuple[EffectParameter, ...]:
        """Return the parameters whose zero switches the effect off."""
        return tuple(parameter for parameter in cls.parameters() if parameter.is_size)

    def with_values(self: _Kind, values: Mapping[str, Any]) -> _Kind:
        """Return a copy with other parameter values."""
        return replace(self, **values)

    def values(self) -> dict[str, float]:
        """Return parameter values by name."""
        return {
            parameter.name: float(getattr(self, parameter.name))
            for parameter in self.parameters()
        }


@dataclass(frozen=True)
class Effect(Parametrised):
    """Base of all effects: no hook changes anything.

    Class attributes:
        name: the field's word, as in the contract of `hmcvt diagnose`.
        form: which of the forms of that name; empty where there is one.
        component: `pump`, `motor`, `gears`, `clutches`, `planetary`, `actuator`, `oil`, or
            `sensor` for an error of the bench, which is no part of what is served.
        summary: what it does, in plain words.
        source: where its form comes from.
        remedy: the measurement that settles it when no operating point can; may be empty.
        shared_error: error of a meter that it is a larger value of, as `SharedError.name`; may be
            empty. Within the class of that meter it is no cause.
        unit_only: whether it is a candidate on the bench of a single pump or motor only.
        change_only: whether it is a candidate against the baseline of a sound machine only.
        needs_oil_temperature: whether it has no size that acts where the oil temperature is not
            known; it is then no candidate.
        assumes_oil_temperature: whether such an effect acts as at 60 deg C where a served model is
            not given the oil temperature; otherwise it is off there.
        varied: base parameters, in proportion to their scaled variables, that differ from point to
            point where it acts; those that a bench does not have are ignored.
        condition: of an effect that is a condition of the test and no damage, the condition at
            which it is off, such as `oil at 60 deg C`; otherwise empty.

    Attributes:
        part: `pump` or `motor` where it acts in that unit alone; empty where in both.
        stage: name of the stage in which alone it acts; empty where in all.
    """

    name: ClassVar[str] = ""
    form: ClassVar[str] = ""
    component: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    source: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    shared_error: ClassVar[str] = ""
    unit_only: ClassVar[bool] = False
    change_only: ClassVar[bool] = False
    needs_oil_temperature: ClassVar[bool] = False
    assumes_oil_temperature: ClassVar[bool] = False
    varied: ClassVar[tuple[str, ...]] = ()
    condition: ClassVar[str] = ""

    part: str = field(default="", kw_only=True)
    stage: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        for parameter in self.parameters():
            value = getattr(self, parameter.name)
            if (
                isinstance(value, bool)
                or not isinstance(value, (int, float))
                or not math.isfinite(value)
            ):
                raise InputError(
                    f"effect {self.name}: {parameter.name} = {value!r} "
                    "is not a finite number"
                )

    @classmethod
    def acts_at(cls, *hooks: str) -> bool:
        """Whether the effect overrides one of these hooks."""
        return any(getattr(cls, hook) is not getattr(Effect, hook) for hook in hooks)

    @classmethod
    def in_unit(
        cls, kind: str, factor: float, largest: Mapping[str, float] | None = None
    ) -> Effect:
        """Return the effect as one of a single `pump` or `motor`.

        Args:
            kind: `pump` or `motor`.
            factor: its displacement / that of the paper's unit; sizes grow with it.
            largest: physical limits of its parameters by name, where they are narrower than those
                of a transmission.
        """
        limits = largest or {}
        own = []
        for item in cls.parameters():
            scaled = item.times(factor)
            highest = min(scaled.high, limits.get(item.name, scaled.high))
            own.append(replace(scaled, high=highest))
        of_unit = tuple(own)
        component = kind if cls.component in ("pump", "motor") else cls.component
        changed: type[Effect] = type(
            cls.__name__,
            (cls,),
            {"component": component, "parameters": staticmethod(lambda: of_unit)},
        )
        return changed()

    def at(self, hook: str, state: ShaftState) -> Value:
        """Evaluate a state hook; in one unit, the other unit is taken as stationary."""
        if self.part:
            other = "motor" if self.part == "pump" else "pump"
            if hook == f"{other}_drag":
                return 0.0
            still = np.zeros_like(state.pressure)
            if other == "motor":
                state = state._replace(motor_speed=still)
            else:
                state = state._replace(pump_speed=still, displacement_ratio=still + 1.0)
        return getattr(self, hook)(state)

    @classmethod
    def depends_on_oil(cls) -> bool:
        """Whether the effect reads the oil temperature."""
        return cls.acts_at(*OIL_HOOKS) or cls.needs_oil_temperature

    # Hooks, in the order in which the power balance meets them; those of a whole state together.

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        """Stroke that the swash plate really has for the one commanded [-]."""
        return displacement_ratio

    def viscosity_ratio(self, oil_temperature: Array) -> Value:
        """Viscosity / viscosity at identification [-]; leakage ~ 1/mu."""
        return 1.0

    def film_viscosity_ratio(self, oil_temperature: Array) -> Value:
        """The same of the films that damp, damping ~ mu [-]."""
        return self.viscosity_ratio(oil_temperature)

    def true_load_power(self, load_power: Array, output_speed: Array) -> Array:
        """Output power that really flows when the bench reads `load_power` [W]."""
        return load_power

    def output_slip(self, torque: Array) -> Value:
        """Speed lost in a closed clutch that passes `torque` [N m] to the output [rad/s].

        Neither is negative; in overrun the output runs ahead by as much.
        """
        return 0.0

    def mechanical_slip(self, torque: Array) -> Value:
        """Speed lost in a closed clutch of the mechanical path, ahead of the row [rad/s].

        As `output_slip`, of a torque at the engine shaft [N m].
        """
        return 0.0

    def gear_loss(self, power: Array, speed: Array) -> Value:
        """Further part of `power` [W] that each gear pair loses [-]; `speed` in rad/s."""
        return 0.0

    def _nothing(self, state: ShaftState) -> Value:
        """Default of a state hook: no contribution."""
        return 0.0

    stroke_lag = _nothing
    """Stroke that the load takes from the one the swash plate would have [-]."""
    output_drag = _nothing
    """Drag torque on the output shaft [N m]."""
    engine_drag = _nothing
    """Drag torque on the engine shaft [N m]."""
    pump_drag = _nothing
    """Drag torque on the pump shaft [N m]."""
    motor_drag = _nothing
    """Torque that opposes the motion of the motor shaft [N m], not negative."""
    planetary_loss = _nothing
    """Fraction of the rolling power lost in the mesh of the planetary row [-]."""
    leakage_flow = _nothing
    """Further flow that does not reach the motor [m3/s]."""
    pressure_drop = _nothing
    """Pressure lost between pump and motor [Pa]; the sign follows the flow."""

    def reading(self, efficiency: Array, state: ShaftState) -> Array:
        """Efficiency that the bench reads where `efficiency` is true [-]."""
        return efficiency

    def output_speed_reading(self, output_speed: Array) -> Array:
        """Output speed that the bench reads [rad/s]."""
        return output_speed

    def pressure_reading(self, pressure: Array) -> Array:
        """Pressure over the motor that the bench reads [Pa]."""
        return pressure

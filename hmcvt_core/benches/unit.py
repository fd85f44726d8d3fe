# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One pump or motor on a bench: the loss terms of the paper, and all that the diagnosis asks.

Pressure, speed and stroke are given, so that the model is explicit, in two channels:

.. math:: Q_l = C \\, dp, \\qquad T_l = f w + c \\, V \\epsilon \\, dp

the leakage of eq. (13), the damping and the friction of eqs (14), (15) with c = 0.01. Effects act
through the hooks that they have in the pump-motor pair.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..diagnosis import Diagnosis, diagnose_system, next_test
from ..diagnosis.observations import TRUST_ASSUMED, TRUST_STATED, Observations, Reading
from ..diagnosis.system import Axis, BaseParameters, Channel, Points
from ..diagnosis.system import Effect as AnyEffect
from ..errors import InputError
from ..files.units import METER_DEVIATION, TELLING, UnitSamples
from ..physics.effects import library
from ..physics.effects.base import Effect, EffectParameter, ShaftState, Value
from ..transmission.parameters import PRIOR_MEAN, PRIOR_SPREAD
from ..transmission.ranges import RPM
from .transmission import OIL_TEMPERATURE

Array = NDArray[np.float64]

STROKE = Axis("displacement_ratio", "-", "displacement ratio", "stroke", 2, 0.001, graded=False,
              told="stroke {0:.2f}")
SPEED = Axis("speed", "rad/s", "speed", "speed [rad/s]", 1, RPM,
             told="{0:.1f} rad/s ({1:.0f} r/min)", second=1.0 / RPM)
PRESSURE = Axis("pressure", "Pa", "pressure", "pressure [Pa]", 0, 1e5, told="{1:.0f} bar",
                second=1e-5)
PARAMETERS = {"leakage": "m3/(s Pa)", "damping": "N m s/rad"}
"""Base parameters and their units."""

FRICTION = 0.01  # c_fp = c_fm of the paper
_SIZE = 55e-6 / (2.0 * np.pi)  # m3/rad, of which the priors of the paper's pair are
_GRID = (5, 6, 6)
_FOLDS, _STEADY = 8, 6
_OF_ANY_SIZE = ("-", "1/GPa")  # sizes in these are the same in small units and in large ones


class HydrostaticUnit:
    """A pump or motor as a `diagnosis.system.System`.

    Attributes:
        kind, displacement: as of `UnitSamples`.
    """

    refusal = "cannot be run"
    advice = "check speed and pressure"

    def __init__(self, samples: UnitSamples) -> None:
        self.kind, self.displacement = samples.kind, samples.displacement
        self._sign = 1.0 if self.kind == "pump" else -1.0
        self.axes: tuple[Axis, ...] = (STROKE, SPEED, PRESSURE, OIL_TEMPERATURE)
        # The errors of meters by class hardly scatter: a table is off smoothly by so much of the
        # ideal flow and torque. Losses nobody listed are larger, as those of an efficiency are.
        off = [METER_DEVIATION * float(each.max())
               for each in (samples.ideal_flow, samples.ideal_torque)]
        deviations = samples.flow_std, samples.torque_std
        self.channels = tuple(
            Channel(name, unit, factor, 2, 0.0, False,
                    (2.5 * off[i], 8.0 * off[i], 25.0 * off[i]), (8.0 * off[i], 25.0 * off[i]),
                    off[i], least=float(np.median(deviations[i])))
            for i, (name, unit, factor) in enumerate((("flow_loss", "L/min", 6e4),
                                                      ("torque_loss", "N m", 1.0))))
        damping = 1 if self.kind == "motor" else 2
        # Half of the pair's leakage, to within a decade; the dampings as in the transmission.
        self.base = BaseParameters(
            tuple(PARAMETERS), np.array([PRIOR_MEAN[0] - np.log10(2.0), PRIOR_MEAN[damping]]),
            np.array([1.0, PRIOR_SPREAD[damping]]), np.array([-16.0, 0.0]),
            np.array([-8.0, 10.0]), self._values)
        size = self.displacement / _SIZE
        varied = np.ptp(samples.displacement_ratio) > STROKE.held
        # On its stop, or in proportion, the plate is the reference displacement; and a charge pump
        # on the shaft is one of the constant torques.
        self.library: tuple[AnyEffect, ...] = tuple(
            Sized(kind(), size, self.kind) for kind in library(units=True)
            if kind.name != "charge_pump" and kind.form != "gain"
            and (varied or kind.name != "displacement_error"))

    def _values(self, base: Array) -> Array:
        size = self.displacement / _SIZE
        return np.array([10.0 ** base[0], base[1]]) * size

    def predict(self, base: Array, effects: Sequence[AnyEffect], points: Points) -> Array:
        """Return loss of flow [m3/s] and of torque [N m] as reckoned from readings, (2, n)."""
        leakage, damping = self._values(base)
        acting = cast("Sequence[Effect]", effects)
        stroke, speed, pressure = (points[axis.name] for axis in (STROKE, SPEED, PRESSURE))
        viscosity: Value = 1.0
        if OIL_TEMPERATURE.name in points:
            for effect in acting:
                viscosity = viscosity * effect.viscosity_ratio(points[OIL_TEMPERATURE.name])
        true = stroke
        for effect in acting:
            true = effect.true_displacement_ratio(true)
        state = self._state(true, speed, pressure, viscosity)
        true = true - _sum(acting, "stroke_lag", state)
        state = state._replace(displacement_ratio=true)
        # What the reference displacement has that the unit has not, and the plate.
        missing = self._sign * self.displacement * (stroke - true)
        flow = (leakage / viscosity * pressure + _sum(acting, "leakage_flow", state)
                + missing * speed)
        torque = (damping * viscosity * speed + FRICTION * self.displacement * true * pressure
                  + _sum(acting, f"{self.kind}_drag", state) - missing * pressure)
        return np.stack([flow, torque])

    def _state(self, stroke: Array, speed: Array, pressure: Array, viscosity: Value) -> ShaftState:
        still = np.zeros_like(speed)
        pump, motor = (speed, still) if self.kind == "pump" else (still, speed)
        return ShaftState(speed, pump, speed, motor, stroke, pressure, viscosity, still, still,
                          self.displacement * stroke * pressure * speed, self.displacement)

    def candidates(self, points: Points, base: Array) -> Points:
        """Return a grid over the range of the tests."""
        rows = [np.unique(np.linspace(points[axis.name].min(), points[axis.name].max(), count))
                for axis, count in zip((STROKE, SPEED, PRESSURE), _GRID, strict=True)]
        grid = dict(zip((STROKE.name, SPEED.name, PRESSURE.name),
                        (each.ravel() for each in np.meshgrid(*rows)), strict=True))
        return {name: grid.get(name, np.full(grid["speed"].size, np.median(points[name])))
                for name in points}

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power of the flow that is lost beyond what is expected [W], (n,)."""
        return (real - expected) * points["pressure"]

    def model_of(
        self, base: Array, effects: Sequence[AnyEffect], samples: UnitSamples
    ) -> UnitModel:
        """Return the refitted model."""
        return UnitModel(self, base, tuple(cast("Sequence[Effect]", effects)), samples)

    def remarks(self, samples: UnitSamples) -> tuple[str, ...]:
        """Say what a missing column costs."""
        return () if samples.oil_temperature is not None else (
            "without column oil_temperature, viscosity cannot be judged",)


@dataclass(frozen=True)
class Sized:
    """An effect at its size in the paper's unit, as it is in one of another displacement.

    Attributes:
        effect: what acts.
        factor: displacement / that of the paper's unit: sizes that grow with it are so much larger.
        kind: of the unit in which it acts.
    """

    effect: Effect
    factor: float
    kind: str

    def __getattr__(self, name: str) -> Any:
        return getattr(self.effect, name)

    @property
    def component(self) -> str:
        """The unit on the bench, where the effect belongs to one."""
        own = self.effect.component
        return self.kind if own in ("pump", "motor") else own

    def parameters(self) -> list[EffectParameter]:
        """As of the effect, with the sizes of this displacement."""
        return [item if item.unit in _OF_ANY_SIZE or not item.is_size else replace(
            item, **{end: self.factor * getattr(item, end) for end in ("typical", "low", "high")})
            for item in self.effect.parameters()]

    def sizes(self) -> list[EffectParameter]:
        """Those of the parameters that switch it off."""
        return [item for item in self.parameters() if item.is_size]

    def with_values(self, values: dict[str, float]) -> Sized:
        """Return a copy with other parameter values."""
        return replace(self, effect=self.effect.with_values(values))


def _sum(effects: Sequence[Effect], hook: str, state: ShaftState) -> Value:
    return sum((getattr(effect, hook)(state) for effect in effects), 0.0)


@dataclass(frozen=True, eq=False)
class UnitModel:
    """A unit with effects, fitted to samples.

    Attributes:
        system, base: whose parameters these are, scaled.
        effects: at their sizes.
        samples: that they were fitted to.
    """

    system: HydrostaticUnit
    base: Array
    effects: tuple[Effect, ...]
    samples: UnitSamples

    @property
    def parameters(self) -> dict[str, float]:
        """Base parameters by name, units as in `PARAMETERS`."""
        return dict(zip(PARAMETERS, self.system.base.values(self.base).tolist(), strict=True))

    def losses(self, samples: UnitSamples) -> Array:
        """Loss of flow [m3/s] and torque [N m] at the points of samples, shape (2, n)."""
        return self.system.predict(self.base, self.effects, _points(samples))

    def covariance(self) -> Array:
        """Of the base parameters as scaled, linearised, sizes of the effects free, (2, 2)."""
        sizes = [(i, item) for i, effect in enumerate(self.effects) for item in effect.sizes()]

        def scaled(theta: Array) -> Array:
            effects = list(self.effects)
            for (i, item), change in zip(sizes, theta[2:].tolist(), strict=True):
                effects[i] = effects[i].with_values(
                    {item.name: effects[i].values()[item.name] + change * item.typical})
            return self.system.predict(self.base + theta[:2], effects, _points(self.samples))

        left = _measured(self.samples) - self.losses(self.samples)
        free = max(left.shape[1] - 1.5, 1.0)
        deviation = np.sqrt(np.sum(left**2, axis=1, keepdims=True) / free)
        steps = 1e-4 * np.eye(2 + len(sizes))
        slopes = np.array([((scaled(step) - scaled(-step)) / 2e-4 / deviation).ravel()
                           for step in steps])
        prior = np.append(self.system.base.spread ** -2.0, np.full(len(sizes), 0.04))
        return np.linalg.inv(slopes @ slopes.T + np.diag(prior))[:2, :2]


def _points(samples: UnitSamples) -> Points:
    names = [axis.name for axis in (STROKE, SPEED, PRESSURE, OIL_TEMPERATURE)]
    return {name: row for name in names if (row := getattr(samples, name)) is not None}


def _measured(samples: UnitSamples) -> Array:
    return np.stack([samples.flow_loss, samples.torque_loss])


def observe_unit(system: HydrostaticUnit, samples: UnitSamples) -> Observations:
    """Set up the two channels; the stroke is an axis where it varies."""
    points = _points(samples)
    axes = tuple(axis for axis in system.axes if axis.name in points
                 and (axis is not STROKE or np.ptp(samples.displacement_ratio) > STROKE.held))
    trust = TRUST_ASSUMED if samples.assumed else TRUST_STATED
    readings = tuple(
        Reading(channel, values, deviation, trust) for channel, values, deviation in zip(
            system.channels, _measured(samples), (samples.flow_std, samples.torque_std),
            strict=True))
    return Observations(axes, points, readings, samples, np.arange(len(samples)),
                        samples.noise_source, samples.assumed, channels=system.channels)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The loss terms of the paper for one pump or motor, as a `System` of the diagnosis.

Pressure, speed and stroke are given, so that the model is explicit, in two channels:

.. math:: Q_l = C \, dp, \qquad T_l = f w + c \, V \epsilon \, dp

the leakage of eq. (13), the damping and the friction of eqs (14), (15). The paper assumes c = 0.01,
because a transmission barely shows it; the tests of a unit do, so that c is refitted as the other
two are (the three coefficients of Wilson 1950). Effects act through their hooks in the pump-motor
pair.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...diagnosis.analysis import rms
from ...diagnosis.observations import Observations
from ...diagnosis.settings import PRIOR_DOF_ASSUMED, PRIOR_DOF_STATED
from ...diagnosis.system import (
    FIELD_SPREADS,
    STEP_SPREADS,
    Array,
    Axis,
    BaseParameters,
    Channel,
    Points,
)
from ...physics.effects import library
from ...physics.effects.base import Effect, ShaftState, Value
from ...physics.effects.hydraulic import CoulombStribeckFull, PressureFrictionStroke
from ...transmission.parameters import PARAMETER_NAMES, PRIOR_MEAN, PRIOR_SPREAD
from ..transmission.channels import DISPLACEMENT_RATIO, ENGINE_SPEED, OIL_TEMPERATURE
from .samples import LOSSES, METER_DEVIATION, UnitSamples, sign_of

STROKE = DISPLACEMENT_RATIO
SPEED = replace(ENGINE_SPEED, name="speed", word="speed")
PRESSURE = Axis(
    name="pressure",
    unit="Pa",
    word="pressure",
    heading="pressure [Pa]",
    digits=0,
    tolerance=1e5,
    test_format="{1:.0f} bar",
    second_unit_factor=1e-5,
)
UNIT_AXES = (STROKE, SPEED, PRESSURE, OIL_TEMPERATURE)

PARAMETERS = {"leakage": "m3/(s Pa)", "damping": "N m s/rad"}
"""Parameters to be identified and their units."""
BASE_NAMES = (*PARAMETERS, "friction", "flow_gain", "torque_gain")
"""Base parameters of a unit; the two gains are errors of the meters."""

CHANNEL_UNITS = {
    "flow_loss": ("L/min", 6e4),
    "torque_loss": ("N m", 1.0),
    "drain_flow": ("L/min", 6e4),
    "electric_power": ("W", 1.0),
}
"""Unit of each channel in reports, and the factor to it from the SI unit."""

FRICTION = 0.01
"""c_fp = c_fm of the paper: friction torque / ideal torque [-]."""
FRICTION_DECADES = 0.5
"""Prior standard deviation of log10 of the friction; assumed, a factor of three either way."""
CHANGE_SPREADS = {"drain_flow": 0.2, "electric_power": 0.05}
"""Deviation of the factor by which a channel shows a change otherwise than predicted; assumed.

A leak between the ports does not reach the case: it is a small part in sound units, and most of a
worn valve plate's. IEC 60034-30-1: the efficiency of motors differs by 5 %.
"""
METER_GAIN = 0.0017
"""Standard deviation of the gain of a flow or torque meter [-].

ISO 4409 allows 0.5 % in class A; that is taken as three standard deviations.
"""
LARGEST_GAIN = 3.0
"""Bound on the gains, in standard deviations."""
PAPER_DISPLACEMENT = 55e-6 / (2.0 * np.pi)
"""Displacement of each unit of the paper's pair, for which the priors hold [m3/rad]."""

PHYSICAL_LIMITS = {"compliance": 3.0}
"""Largest physical values of parameters of effects on the bench of a unit.

1 / bulk modulus of oil with air: about 3 1/GPa (Merritt 1967, Hydraulic Control Systems, 2.2).
"""


class UnitBase(NamedTuple):
    """Base parameters of a unit in their units.

    Attributes:
        leakage: leakage flow per pressure [m3/(s Pa)].
        damping: viscous torque per speed [N m s/rad].
        friction: friction torque / ideal torque [-].
        flow_gain: relative error of the flow meter [-].
        torque_gain: relative error of the torque meter [-].
    """

    leakage: float
    damping: float
    friction: float
    flow_gain: float
    torque_gain: float


class HydrostaticUnit:
    """A pump or motor as a `System`; its gap is measured in the flow loss.

    Args:
        samples: give kind and displacement of the unit, and the accuracy of its meters.
    """

    axes: tuple[Axis, ...] = UNIT_AXES
    refusal = "cannot be run"
    advice = "check speed and pressure"

    def __init__(self, samples: UnitSamples) -> None:
        self.kind = samples.kind
        self.displacement = float(samples.displacement)
        self.size = self.displacement / PAPER_DISPLACEMENT
        self.channels = tuple(
            channel for channel in unit_channels(samples) if channel.name in LOSSES
        )
        self.base = _base_parameters(self.kind, self.size)
        stroke_varies = np.ptp(samples.displacement_ratio) > STROKE.tolerance
        self.library: tuple[Any, ...] = _library(
            self.kind, self.size, bool(stroke_varies)
        )

    def base_values(self, base: Array) -> UnitBase:
        """Return the base parameters of scaled variables, shape (5,)."""
        return UnitBase(*self.base.values(base).tolist())

    def predict(self, base: Array, effects: Sequence[Any], points: Points) -> Array:
        """Return the losses that follow from the readings of the meters.

        Args:
            base: scaled base parameters, shape (5,).
            effects: at their sizes.
            points: operating points, n values along each axis.

        Returns:
            Loss of flow [m3/s] and of torque [N m], those that are read, shape (channels, n).
        """
        flow_loss, torque_loss = self.losses(base, effects, points)
        rows = {"flow_loss": flow_loss, "torque_loss": torque_loss}
        return np.stack([rows[channel.name] for channel in self.channels])

    def losses(self, base: Array, effects: Sequence[Any], points: Points) -> Array:
        """Return loss of flow [m3/s] and of torque [N m], read or not, shape (2, n).

        Args:
            base: scaled base parameters, shape (5,).
            effects: at their sizes.
            points: operating points, n values along each axis.
        """
        values = self.base_values(base)
        stroke = points[STROKE.name]
        speed = points[SPEED.name]
        pressure = points[PRESSURE.name]
        film_viscosity, viscosity = _viscosity_ratios(effects, points)
        state = self._state(effects, points, viscosity)
        true_stroke = state.displacement_ratio

        def total(hook: str) -> Value:
            return sum((getattr(effect, hook)(state) for effect in effects), 0.0)

        flow_loss = values.leakage / viscosity * pressure + total("leakage_flow")
        torque_loss = (
            values.damping * film_viscosity * speed
            + values.friction * true_stroke * (self.displacement * pressure)
            + total(f"{self.kind}_drag")
        )
        # Tables state losses against the stated displacement and the commanded stroke.
        sign = sign_of(self.kind)
        flow_way = -sign
        torque_way = sign
        ideal_flow = self.displacement * speed
        ideal_torque = self.displacement * pressure
        flow_read = (true_stroke * ideal_flow + flow_way * flow_loss) * (
            1.0 + values.flow_gain
        )
        torque_read = (true_stroke * ideal_torque + torque_way * torque_loss) * (
            1.0 + values.torque_gain
        )
        return np.stack(
            [
                flow_way * (flow_read - stroke * ideal_flow),
                torque_way * (torque_read - stroke * ideal_torque),
            ]
        )

    def _state(
        self, effects: Sequence[Any], points: Points, viscosity: Array
    ) -> ShaftState:
        """State of the shafts at the stroke that effects leave."""
        stroke = points[STROKE.name]
        for effect in effects:
            stroke = effect.true_displacement_ratio(stroke)
        state = shaft_state(self, {**points, STROKE.name: stroke}, viscosity)
        lag = sum((effect.stroke_lag(state) for effect in effects), 0.0)
        return state._replace(displacement_ratio=stroke - lag)

    def candidates(self, points: Points, base: Array) -> Points:
        """Return a grid of tests over the range of the campaign, at its median oil temperature."""
        rows: list[Any] = []
        for name, values in points.items():
            if name == OIL_TEMPERATURE.name:
                rows.append(np.median(values))
            else:
                rows.append(np.unique(np.linspace(values.min(), values.max(), 6)))
        grid = np.meshgrid(*rows)
        return {name: values.ravel() for name, values in zip(points, grid, strict=True)}

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power of the flow that is lost beyond what is expected [W].

        Args:
            points: operating points.
            expected: flow loss of the reference [m3/s], shape (n,).
            real: flow loss to compare [m3/s], shape (n,).
        """
        return (real - expected) * points[PRESSURE.name]

    def model_of(
        self,
        base: Array,
        effects: Sequence[Any],
        samples: UnitSamples,
        covariance: Array | None = None,
    ) -> UnitModel:
        """Return the refitted model; friction above the paper's is an effect, as in a pair.

        Args:
            base: scaled base parameters, shape (5,).
            effects: at their fitted sizes.
            samples: to which they were fitted.
            covariance: of the scaled base parameters, shape (5, 5), or None.
        """
        friction = self.base_values(base).friction
        limited = np.array(base)
        index = BASE_NAMES.index("friction")
        limited[index] = min(limited[index], 0.0)
        added = tuple(effects)
        if friction > FRICTION:
            excess = PressureFrictionStroke(coefficient=friction - FRICTION)
            added = (*added, excess)
        return UnitModel(self, limited, added, friction, covariance)

    def remarks(self, samples: UnitSamples) -> tuple[str, ...]:
        """Return notes on what a missing column costs."""
        if samples.oil_temperature is not None:
            return ()
        return ("without column oil_temperature, viscosity cannot be judged",)


@dataclass(frozen=True, eq=False)
class UnitModel:
    """A unit with effects at their sizes.

    Attributes:
        system: the unit.
        base: scaled base parameters, shape (5,).
        effects: at their sizes.
        friction: all of it, c; the part above that of the paper is one of `effects`.
        covariance: of the scaled base parameters, shape (5, 5), or None where it is not known.
    """

    system: HydrostaticUnit
    base: Array
    effects: tuple[Effect, ...]
    friction: float = FRICTION
    covariance: Array | None = None

    @property
    def parameters(self) -> dict[str, float]:
        """Identified parameters by name, units as in `PARAMETERS`."""
        values = self.system.base_values(self.base)
        return {"leakage": values.leakage, "damping": values.damping}

    def losses(self, samples: UnitSamples) -> Array:
        """Return loss of flow [m3/s] and torque [N m] at the points of samples, shape (2, n)."""
        return self.system.losses(self.base, self.effects, points_of(samples))

    def predict(self, samples: UnitSamples) -> dict[str, Array]:
        """Return both losses at the points of samples, by channel, shape (n,) each."""
        return dict(zip(LOSSES, self.losses(samples), strict=True))

    def rmse(self, samples: UnitSamples) -> list[float | None]:
        """Return the root mean square error of both losses [m3/s], [N m]; None where not read."""
        return loss_errors(self.predict(samples), samples)


def loss_errors(
    predicted: Mapping[str, Array], samples: UnitSamples
) -> list[float | None]:
    """Return the root mean square error of both losses [m3/s], [N m]; None where not read.

    Args:
        predicted: losses by channel at the points of the samples, shape (n,) each.
        samples: that are read.
    """
    errors: list[float | None] = []
    for name in LOSSES:
        measured = getattr(samples, name)
        if measured is None or name not in predicted:
            errors.append(None)
        else:
            errors.append(rms(measured - predicted[name]))
    return errors


def shaft_state(unit: HydrostaticUnit, points: Points, viscosity: Array) -> ShaftState:
    """Return the state of the shafts of a unit; the other unit stands still.

    Args:
        unit: gives kind and displacement.
        points: operating points, shape (n,) along each axis.
        viscosity: viscosity / viscosity at identification, shape (n,).
    """
    speed = points[SPEED.name]
    still = np.zeros_like(speed)
    pump_speed = motor_speed = still
    if unit.kind == "pump":
        pump_speed = speed
    else:
        motor_speed = speed
    return ShaftState(
        engine_speed=speed,
        pump_speed=pump_speed,
        output_speed=speed,
        motor_speed=motor_speed,
        displacement_ratio=points[STROKE.name],
        pressure=points[PRESSURE.name],
        viscosity_ratio=viscosity,
        sun_speed=still,
        sun_torque=still,
        load_power=still,
        displacement=unit.displacement,
    )


def points_of(samples: UnitSamples) -> Points:
    """Return the operating points of samples along the axes that they record."""
    points = {}
    for axis in UNIT_AXES:
        values = getattr(samples, axis.name)
        if values is not None:
            points[axis.name] = values
    return points


def observe_unit(system: HydrostaticUnit, samples: UnitSamples) -> Observations:
    """Set up the two channels of a unit; the stroke is an axis where it varies."""
    points = points_of(samples)
    axes = [axis for axis in UNIT_AXES if axis.name in points]
    if np.ptp(samples.displacement_ratio) <= STROKE.tolerance:
        axes.remove(STROKE)
    assumed = samples.noise is None
    prior_dof = PRIOR_DOF_ASSUMED if assumed else PRIOR_DOF_STATED
    return Observations(
        axes=tuple(axes),
        points=points,
        channels=system.channels,
        measured=np.stack(
            [getattr(samples, channel.name) for channel in system.channels]
        ),
        deviation=np.stack(
            [samples.deviation_of(channel.name) for channel in system.channels]
        ),
        prior_dof=np.full(len(system.channels), prior_dof),
        samples=samples,
        number=np.arange(len(samples)),
        noise_source="assumed, ISO 4409 class A" if assumed else "given",
        assumed=assumed,
    )


def unit_channels(samples: UnitSamples) -> tuple[Channel, ...]:
    """Return the channels that are read; errors within the class of a meter do not scatter."""
    channels = []
    for name in samples.channels:
        unit, factor = CHANNEL_UNITS[name]
        meter = METER_DEVIATION * float(_full_scale(samples, name))
        channels.append(
            Channel(
                name=name,
                unit=unit,
                factor=factor,
                digits=2,
                uncertainty=0.0,
                relative=False,
                field_spreads=tuple(spread * meter for spread in FIELD_SPREADS),
                step_spreads=tuple(spread * meter for spread in STEP_SPREADS),
                misfit_spread=meter,
                least=float(np.median(samples.deviation_of(name))),
                change_spread=CHANGE_SPREADS.get(name, 0.0),
            )
        )
    return tuple(channels)


def _full_scale(samples: UnitSamples, channel: str) -> float:
    """Return the largest ideal value of what the meter of a channel reads."""
    ideal_flow, ideal_torque = samples.ideal.max(axis=1)
    if channel == "flow_loss":
        return float(ideal_flow)
    if channel == "torque_loss":
        return float(ideal_torque)
    return float(np.abs(samples.meter_reading(channel)).max())


def _base_parameters(kind: str, size: float) -> BaseParameters:
    """Priors of the paper's pair, scaled to a unit `size` times as large.

    Scaled variables: log10 of leakage and friction, damping as it is, gains in deviations.
    """
    damping = PARAMETER_NAMES.index(f"{kind}_damping")
    leakage = PARAMETER_NAMES.index("leakage")
    scales = UnitBase(size, size, FRICTION, METER_GAIN, METER_GAIN)
    # A single unit leaks half of what the pair does, within a factor of ten.
    mean = UnitBase(
        PRIOR_MEAN[leakage] - np.log10(2.0), PRIOR_MEAN[damping], 0.0, 0.0, 0.0
    )
    spread = UnitBase(1.0, PRIOR_SPREAD[damping], FRICTION_DECADES, 1.0, 1.0)
    low = UnitBase(-16.0, 0.0, -2.0, -LARGEST_GAIN, -LARGEST_GAIN)
    high = UnitBase(-8.0, 10.0, 1.2, LARGEST_GAIN, LARGEST_GAIN)
    return BaseParameters(
        names=BASE_NAMES,
        mean=np.array(mean),
        spread=np.array(spread),
        low=np.array(low),
        high=np.array(high),
        values=partial(_values, scales=np.array(scales)),
        units=(*PARAMETERS.values(), "-", "-", "-"),
    )


def _values(base: Array, scales: Array) -> Array:
    """Return the base parameters in their units for scaled variables."""
    leakage, damping, friction, flow_gain, torque_gain = base
    plain = UnitBase(10.0**leakage, damping, 10.0**friction, flow_gain, torque_gain)
    return scales * np.array(plain)


def _library(kind: str, size: float, stroke_varies: bool) -> tuple[Effect, ...]:
    """Effects of a unit, without those that its tests cannot distinguish from another one.

    A charge pump on the shaft is a constant torque, a gain of the stroke is the reference
    displacement, and friction in proportion to the stroke is a base parameter. At a constant stroke
    the plate is the reference displacement too, and friction at full stroke is the base's.
    """
    excluded = {"charge_pump", "gain", PressureFrictionStroke.form}
    if not stroke_varies:
        excluded |= {"displacement_error", "at full stroke", CoulombStribeckFull.form}
    return tuple(
        effect.in_unit(kind, size, PHYSICAL_LIMITS)
        for effect in library(units=True)
        if effect.name not in excluded and effect.form not in excluded
    )


def _viscosity_ratios(effects: Sequence[Any], points: Points) -> tuple[Value, Array]:
    """Viscosity of films and of gaps / viscosity at identification [-]."""
    film: Value = 1.0
    viscosity = np.ones_like(points[SPEED.name])
    temperature = points.get(OIL_TEMPERATURE.name)
    if temperature is None:
        return film, viscosity
    for effect in effects:
        film = film * effect.film_viscosity_ratio(temperature)
        viscosity = viscosity * effect.viscosity_ratio(temperature)
    return film, viscosity

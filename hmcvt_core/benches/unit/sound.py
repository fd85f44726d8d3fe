# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""A sound pump or motor as a baseline: physical terms of real units and a smooth remainder.

The terms are those that models of real units share (Wilson 1950; Schloesser 1961; Thoma 1964;
McCandlish & Dorey 1984; Ivantysyn & Ivantysynova), linear in their coefficients, which are not
negative:

.. math:: Q_l = a_1 \frac{dp}{\mu} + a_2 V w \, dp + a_3 \sqrt{dp} + a_4 \frac{dp}{\mu w}

.. math:: T_l = b_0 + b_1 \mu w + b_2 V \epsilon \, dp + b_3 w^2 + b_4 w \, dp

A further term of either sign in proportion to the ideal flow or torque stands for an error of the
displacement, which is known to about one percent (ISO 8426). What the terms leave is smooth
(`hmcvt_core.benches.baseline.remainder`). Prior sizes are the typical ones of the effects of the
library.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.observations import Observations
from ...diagnosis.results.outcome import Cause
from ...diagnosis.settings import PRIOR_DOF_STATED
from ...diagnosis.system import Array, Axis, Channel, Points
from ...physics.effects.base import Effect, ShaftState
from ...physics.effects.hydraulic import (
    Compressibility,
    OilTemperature,
    OrificeLeakage,
    PressureFrictionFull,
    PressureFrictionStroke,
    PressureLeakage,
    SlowLeakagePower,
    StrokeLeakage,
)
from ...physics.effects.mechanical import (
    BarrelChurning,
    ConstantTorque,
    PressureViscosity,
)
from ...physics.effects.wear import (
    AeratedOil,
    LaminarLeakage,
    UnreadOilTemperature,
    ViscousDamping,
)
from ..baseline import CLASS_TO_DRIFT, Growth, HeldMachine, min_widths, stacked
from ..baseline.remainder import Remainder, Training, fit_remainder
from ..transmission.channels import OIL_TEMPERATURE
from .samples import UnitSamples, sign_of
from .system import (
    METER_GAIN,
    PAPER_DISPLACEMENT,
    PRESSURE,
    SPEED,
    STROKE,
    UNIT_AXES,
    HydrostaticUnit,
    points_of,
    shaft_state,
    unit_channels,
)

FLOW_TERMS: tuple[Effect, ...] = (
    LaminarLeakage(leakage=5e-12),
    Compressibility(compliance=1.0, dead_volume=0.5, softening=0.0, motor_part=1.0),
    OrificeLeakage(flow=1.5e-4),
    SlowLeakagePower(leakage=1e-12, exponent=1.0),
)
"""Terms of the flow loss of a unit of the paper's displacement, at their prior deviations.

Sizes: typical ones of the effects; the compliance is that of oil with some air (Merritt 1967).
"""
TORQUE_TERMS: tuple[Effect, ...] = (
    ConstantTorque(torque=4.0),
    ViscousDamping(damping=0.2),
    PressureFrictionStroke(coefficient=0.04),
    BarrelChurning(torque=4.0),
    PressureViscosity(torque=8.0),
)
"""The same of the torque loss."""
DISPLACEMENT_DEVIATION = 0.01
"""Prior deviation of displacement / stated displacement - 1; ISO 8426 reaches about one percent."""
MOTOR_LOSS = 1.0 / 0.88 - 1.0
"""Fraction by which the electric power exceeds that of the shaft.

IEC 60034-30-1: nominal efficiency of 0.84 to 0.92 for IE2 motors of 2 to 30 kW.
"""
METER_ZERO = 0.0005
"""Standard deviation of the zero of a meter, as a part of its largest reading; assumed.

Makers of flow and torque meters state 0.05 to 0.1 % of full scale.
"""
DRAIN_ZERO = 0.01
"""Standard deviation of the zero of a drain flow between two campaigns, as a part of the largest.

The meter is chosen for a worn unit: its full scale, of which makers state 0.1 %, is some ten times
what a sound unit drains; assumed.
"""
POWER_GAIN = 0.005
"""Standard deviation of the gain of an electric power between two campaigns [-].

A motor loses some percent of its losses less when cold; meter of class 0.5 (IEC 62053).
"""
VISCOUS_TERM = {
    "flow_loss": 0,
    "torque_loss": 1,
    "drain_flow": 0,
    "electric_power": 1,
}
"""Index of the term of each channel that follows the viscosity."""
VISCOSITY_DEVIATION = 0.5
"""Standard deviation of the power of viscosity by which a laminar term changes beyond the baseline.

Leakage follows viscosity with a power between -1 in gaps and 0 in orifices.
"""
CONSTANT_POWER = 500.0
"""Prior deviation of a power that an electric motor takes at no load [W]; assumed."""
VARIED_FRACTION = 0.15
"""Fraction of the largest value of an axis by which it has to vary to show a form along it.

At 0.15 a linear and a square form differ by a few percent, about what forms of effects err.
"""
MIN_WIDTHS = {OIL_TEMPERATURE.name: 20.0}
"""Minimum ranges for the remainder [K]: about as much halves the viscosity of a mineral oil."""
NEEDED_AXES: Mapping[type[Effect], str] = MappingProxyType(
    {
        PressureLeakage: PRESSURE.name,
        SlowLeakagePower: SPEED.name,
        AeratedOil: SPEED.name,
        StrokeLeakage: STROKE.name,
        PressureFrictionFull: STROKE.name,
        BarrelChurning: SPEED.name,
    }
)
"""Changes that are candidates only where the tests vary along an axis.

Without that they are the same curve as leakage, friction or a constant torque, and are named as
such. A change of compressibility or churning is rarer than wear.
"""


@dataclass(frozen=True, eq=False)
class SoundUnit(HeldMachine):
    """A sound unit, held: a `SoundMachine`.

    Attributes:
        samples: of the baseline that were fitted.
        unit: the unit as a system, for axes and operating points.
        channels: that are compared.
        remainders: the fit of each channel.
        library: changes that are candidates.
        untestable: changes that the tests cannot distinguish from others, for want of an axis.
        source: of the baseline.
        extrapolates: whether the terms that follow the viscosity are used at oil temperatures
            beyond those of the baseline. Otherwise these count as a change.
        inflation: factor of all standard deviations, above 1 where the control differs.
    """

    samples: UnitSamples
    unit: HydrostaticUnit
    channels: tuple[Channel, ...]
    remainders: tuple[Remainder, ...]
    library: tuple[Any, ...]
    untestable: tuple[Any, ...]
    source: str
    extrapolates: bool = False
    inflation: float = 1.0

    refusal = HydrostaticUnit.refusal
    advice = HydrostaticUnit.advice
    remainder_axes = UNIT_AXES

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of an operating point."""
        return self.unit.axes

    @property
    def count(self) -> int:
        """Number of sound samples that were fitted."""
        return len(self.samples)

    def sound_at(self, points: Points) -> tuple[Array, Array]:
        """Return mean and covariance of the channels, shapes (channels, n), (channels, n, n)."""
        within = self.within_temperatures(points)
        means = []
        covariances = []
        for channel, remainder in zip(self.channels, self.remainders, strict=True):
            columns, _, _ = _terms(self.unit, channel.name, within)
            mean, covariance = remainder.predict(self.stacked(within), columns)
            unknown = self._unknown_viscosity(channel.name, within)
            means.append(mean)
            covariance = covariance + np.outer(unknown, unknown)
            covariances.append(self.inflation**2 * covariance)
        return np.stack(means), np.stack(covariances)

    def _unknown_viscosity(self, channel: str, points: Points) -> Array:
        """Return one deviation of a channel by oil beyond the temperatures of the baseline, (n,).

        Args:
            channel: name.
            points: operating points.
        """
        known = self.samples.oil_temperature
        if known is None or OIL_TEMPERATURE.name not in points:
            return np.zeros_like(points[SPEED.name])
        temperature = points[OIL_TEMPERATURE.name]
        nearest = {
            **points,
            OIL_TEMPERATURE.name: temperature.clip(known.min(), known.max()),
        }
        beyond = np.log(_viscosity(points) / _viscosity(nearest))
        state = shaft_state(self.unit, points, _viscosity(points))
        return VISCOSITY_DEVIATION * self._laminar(channel, state) * beyond

    def within_temperatures(self, points: Points) -> Points:
        """Return points with oil temperatures limited to those of the baseline.

        What warmer oil changes is a separate candidate.
        """
        warm = self.samples.oil_temperature
        if warm is None or self.extrapolates or OIL_TEMPERATURE.name not in points:
            return points
        limited = points[OIL_TEMPERATURE.name].clip(warm.min(), warm.max())
        return {**points, OIL_TEMPERATURE.name: limited}

    def changed_by_each(self, sets: Sequence[Sequence[Any]], points: Points) -> Array:
        """Return how each set of effects changes the channels, shape (sets, channels, n)."""
        return np.stack([self.changed_by(effects, points) for effects in sets])

    def changed_by(self, effects: Sequence[Any], points: Points) -> Array:
        """Return how effects change the channels, shape (channels, n)."""
        thin = _viscosity_change(self, effects, points)
        state = shaft_state(self.unit, points, _viscosity(points))
        flow = sum((effect.leakage_flow(state) for effect in effects), 0.0)
        drag = sum(
            (getattr(effect, f"{self.unit.kind}_drag")(state) for effect in effects),
            0.0,
        )
        thinner = 1.0 / thin - 1.0
        drain = flow + self._laminar("drain_flow", state) * thinner
        flow = flow + self._laminar("flow_loss", state) * thinner
        drag = drag + self._laminar("torque_loss", state) * (thin - 1.0)
        shaft_power = drag * points[SPEED.name]
        rows = {
            "flow_loss": flow,
            "torque_loss": drag,
            "drain_flow": drain,
            "electric_power": (1.0 + MOTOR_LOSS) * shaft_power,
        }
        zero = np.zeros(len(points[SPEED.name]))
        return np.stack([zero + rows[channel.name] for channel in self.channels])

    def _laminar(self, name: str, state: ShaftState) -> Array:
        """Return the part of a sound channel that follows the viscosity, shape (n,).

        Args:
            name: of the channel.
            state: operating points, at the viscosity of the baseline.
        """
        names = [channel.name for channel in self.channels]
        if name not in names:
            return np.zeros_like(state.pressure)
        remainder = self.remainders[names.index(name)]
        index = VISCOUS_TERM[name]
        # The remainder may hold a part that the baseline could not attribute, at one temperature.
        columns = _term_columns(self.unit, name, state)
        return np.asarray(columns[:, index] * remainder.coefficients[index])

    def meter_errors(self, points: Points, sound: Array) -> tuple[list[str], Array]:
        """Return names of errors of the meters, and what one deviation of each changes."""
        names = []
        errors = []
        speed = points[SPEED.name]
        stroke = points.get(STROKE.name, np.ones_like(speed))
        sign = sign_of(self.unit.kind)
        ideal_flow = self.unit.displacement * stroke * speed
        ideal_torque = self.unit.displacement * stroke * points[PRESSURE.name]
        for i, channel in enumerate(self.channels):
            reading = sound[i]
            gain = METER_GAIN / CLASS_TO_DRIFT
            zero = METER_ZERO / CLASS_TO_DRIFT
            if channel.name == "flow_loss":
                reading = sound[i] - sign * ideal_flow
            elif channel.name == "torque_loss":
                reading = sound[i] + sign * ideal_torque
            elif channel.name == "electric_power":
                gain = POWER_GAIN
            elif channel.name == "drain_flow":
                zero = DRAIN_ZERO
            largest = np.abs(self.samples.meter_reading(channel.name)).max()
            for word, change in (
                ("gain", gain * reading),
                ("zero", np.full_like(speed, zero * largest)),
            ):
                names.append(f"{channel.name}_{word}")
                row = np.zeros_like(sound)
                row[i] = change
                errors.append(row)
        return names, np.stack(errors)

    def candidates(self, points: Points) -> Points:
        """Return a grid of tests over the range of the campaign."""
        return self.unit.candidates(points, np.zeros(0))

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond that of the sound unit [W]."""
        change = real - expected
        name = self.channels[0].name
        if name == "torque_loss":
            return change * points[SPEED.name]
        if name == "electric_power":
            return change
        return change * points[PRESSURE.name]

    def model_of(
        self, effects: Sequence[Any], samples: Any, meters: Array | None = None
    ) -> ChangedUnit:
        """Return the unit with its changes."""
        return ChangedUnit(self, tuple(effects))

    def growth_of(self, cause: Cause, samples: UnitSamples) -> Growth | None:
        """Return by how much more flow is lost, if a cause is a leak."""
        if self.channels[0].name != "flow_loss":
            return None
        effects = (item for item in cause.model.effects if item.name == cause.effect)
        effect = next(effects, None)
        if effect is None:
            return None
        points = points_of(samples)
        name = effect.sizes()[0].name
        size = cause.parameters[name]
        effect = effect.with_values({name: size["value"]})
        change = float(np.mean(self.changed_by((effect,), points)[0]))
        mean, covariance = self.sound_at(points)
        before = float(np.mean(mean[0]))
        if min(change, before) <= 0.0 or size["value"] <= 0.0:
            return None
        lost = {
            "value": change,
            "standard_error": change * size["standard_error"] / size["value"],
            "unit": self.channels[0].unit,
        }
        error = float(np.sqrt(np.mean(covariance[0])))
        return Growth.of("flow loss", cause, lost, before, error / before)

    def remarks(self, samples: UnitSamples) -> tuple[str, ...]:
        """Return notes on what missing columns cost."""
        notes = []
        if self.samples.oil_temperature is None:
            notes.append(
                "without column oil_temperature in both files, warmer oil looks like wear of gaps"
            )
        if "torque_loss" not in samples.channels:
            notes.append(
                "no torque is read: a change of friction or damping is not seen"
            )
        return tuple(notes)


@dataclass(frozen=True, eq=False)
class ChangedUnit:
    """A sound unit with changes at their sizes.

    Attributes:
        sound: the unit before.
        effects: changes.
    """

    sound: SoundUnit
    effects: tuple[Any, ...]

    def predict(self, samples: UnitSamples) -> dict[str, Array]:
        """Return the channels at the points of samples, by name, shape (n,) each."""
        points = points_of(samples)
        mean, _ = self.sound.sound_at(points)
        mean = mean + self.sound.changed_by(self.effects, points)
        names = [channel.name for channel in self.sound.channels]
        return dict(zip(names, mean, strict=True))

    def rmse(self, samples: UnitSamples) -> dict[str, float]:
        """Return the root mean square error of each channel, by name, in its unit."""
        errors = {}
        for name, predicted in self.predict(samples).items():
            error = getattr(samples, name) - predicted
            errors[name] = float(np.sqrt(np.mean(error**2)))
        return errors


def fit_sound_unit(
    samples: UnitSamples, channels: Sequence[str], varied: Sequence[str]
) -> SoundUnit:
    """Fit terms and remainder of every channel to sound samples.

    Args:
        samples: of the sound unit; with an oil temperature only where both campaigns read it.
        channels: names of those that are compared.
        varied: names of the axes along which the tests of the changed unit vary.
    """
    unit = HydrostaticUnit(samples)
    described = tuple(
        replace(channel, misfit_spread=channel.misfit_spread / CLASS_TO_DRIFT)
        for channel in unit_channels(samples)
        if channel.name in channels
    )
    points = points_of(samples)
    remainders = []
    for channel in described:
        columns, spread, nonnegative = _terms(unit, channel.name, points)
        training = Training(
            points=stacked(points, UNIT_AXES),
            columns=columns,
            spread=spread,
            values=np.asarray(getattr(samples, channel.name)),
            noise=_reading_deviation(samples, channel.name),
            smooth_deviation=CLASS_TO_DRIFT * channel.misfit_spread,
            nonnegative=nonnegative,
            min_width=min_widths(points, UNIT_AXES, MIN_WIDTHS),
            order=np.arange(float(len(samples))),
            noise_stated=samples.noise is not None,
        )
        remainders.append(fit_remainder(training))
    untestable = [kind for kind, axis in NEEDED_AXES.items() if axis not in varied]
    return SoundUnit(
        samples=samples,
        unit=unit,
        channels=described,
        remainders=tuple(remainders),
        library=_changes(samples, varied, samples.oil_temperature is not None),
        untestable=_of_unit(samples, untestable),
        source=samples.source,
    )


def _reading_deviation(samples: UnitSamples, channel: str) -> Array:
    """Return the standard deviation of readings, with that of the zero of the meter, shape (n,).

    Without the zero, tests at low speed would outweigh all others.
    """
    largest = np.abs(samples.meter_reading(channel)).max()
    return np.hypot(samples.deviation_of(channel), METER_ZERO * largest)


def observe_change(sound: SoundUnit, samples: UnitSamples) -> Observations:
    """Set up the channels of samples, with the noise that the baseline shows.

    Args:
        sound: the baseline.
        samples: with the columns that are compared.
    """
    points = points_of(samples)
    # The viscosity is known along the oil temperature, so forms have no error along it.
    axes = [SPEED, PRESSURE]
    if np.ptp(samples.displacement_ratio) > STROKE.tolerance:
        axes.insert(0, STROKE)
    measured = []
    deviation = []
    for channel, remainder in zip(sound.channels, sound.remainders, strict=True):
        measured.append(getattr(samples, channel.name))
        stated = _reading_deviation(samples, channel.name)
        ratio = sound.inflation * remainder.noise_ratio_at(sound.stacked(points))
        deviation.append(ratio * stated)
    return Observations(
        axes=tuple(axes),
        points=points,
        channels=sound.channels,
        measured=np.stack(measured),
        deviation=np.stack(deviation),
        prior_dof=np.full(len(measured), PRIOR_DOF_STATED),
        samples=samples,
        number=np.arange(len(samples)),
        noise_source="scatter of the baseline",
    )


def _changes(
    samples: UnitSamples, varied: Sequence[str], with_temperature: bool
) -> tuple[Any, ...]:
    """Return the changes that the tests can show; of the same curves the first stands for others.

    Args:
        samples: of the unit.
        varied: names of the axes along which both campaigns vary.
        with_temperature: whether both campaigns read the oil temperature.
    """
    kinds: list[type[Effect]] = []
    if not with_temperature:
        kinds.append(UnreadOilTemperature)
    kinds += [
        LaminarLeakage,
        OrificeLeakage,
        ConstantTorque,
        ViscousDamping,
        PressureFrictionStroke,
    ]
    for kind, axis in NEEDED_AXES.items():
        if axis in varied:
            kinds.append(kind)
    return _of_unit(samples, kinds)


def _of_unit(samples: UnitSamples, kinds: Sequence[type[Effect]]) -> tuple[Any, ...]:
    """Return effects as those of a unit of a size."""
    size = samples.displacement / PAPER_DISPLACEMENT
    return tuple(kind.in_unit(samples.kind, size) for kind in kinds)


def with_oil_temperature(sound: SoundUnit) -> SoundUnit:
    """Return a sound unit of which nothing but the oil temperature may have changed."""
    return replace(sound, library=_of_unit(sound.samples, [OilTemperature]))


def varied_axes(samples: UnitSamples) -> list[str]:
    """Return the names of the axes along which samples vary enough to show a form."""
    varied = []
    for axis in UNIT_AXES:
        values = getattr(samples, axis.name)
        if values is None:
            continue
        if np.ptp(values) > VARIED_FRACTION * np.abs(values).max():
            varied.append(axis.name)
    return varied


# --- physical terms ------------------------------------------------------------------------


def _viscosity(points: Points) -> Array:
    """Return viscosity / that at 60 deg C of an ISO VG 46 oil; 1 where no temperature is read."""
    temperature = points.get(OIL_TEMPERATURE.name)
    if temperature is None:
        return np.ones_like(points[SPEED.name])
    return np.asarray(OilTemperature(strength=1.0).viscosity_ratio(temperature))


def _terms(
    unit: HydrostaticUnit, channel: str, points: Points
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the physical terms of a channel.

    Args:
        unit: whose displacement scales them.
        channel: name.
        points: operating points, shape (n,).

    Returns:
        Columns, shape (n, p), prior deviations of their coefficients, and which coefficients are
        at least zero, shape (p,) each.
    """
    state = shaft_state(unit, points, _viscosity(points))
    columns = _term_columns(unit, channel, state)
    count = columns.shape[1]
    spread = np.ones(count)
    nonnegative = np.ones(count, dtype=bool)
    ideal_flow = unit.displacement * state.displacement_ratio * points[SPEED.name]
    ideal_torque = unit.displacement * state.displacement_ratio * points[PRESSURE.name]
    further: dict[str, list[tuple[Array, float]]] = {
        "flow_loss": [(ideal_flow, DISPLACEMENT_DEVIATION)],
        "torque_loss": [(ideal_torque, DISPLACEMENT_DEVIATION)],
        "drain_flow": [],
        "electric_power": [
            (ideal_torque * points[SPEED.name], 1.0 + MOTOR_LOSS),
            (np.ones_like(ideal_flow), CONSTANT_POWER),
        ],
    }
    for column, deviation in further[channel]:
        columns = np.column_stack([columns, column])
        spread = np.append(spread, deviation)
        nonnegative = np.append(nonnegative, False)
    return columns, spread, nonnegative


def _term_columns(unit: HydrostaticUnit, channel: str, state: ShaftState) -> Array:
    """Return the terms of a channel that have a physical sign, shape (n, p)."""
    size = unit.displacement / PAPER_DISPLACEMENT
    speed = state.pump_speed + state.motor_speed
    rows = []
    if channel in ("flow_loss", "drain_flow"):
        for effect in FLOW_TERMS:
            if channel == "drain_flow" and isinstance(effect, Compressibility):
                continue  # squeezed oil stays in the cylinders
            # Effects state compressibility with the displacement of the state.
            factor = 1.0 if isinstance(effect, Compressibility) else size
            rows.append(factor * effect.leakage_flow(state))
    else:
        power = channel == "electric_power"
        for effect in TORQUE_TERMS:
            factor = 1.0 if isinstance(effect, PressureFrictionStroke) else size
            drag = factor * getattr(effect, f"{unit.kind}_drag")(state)
            rows.append((1.0 + MOTOR_LOSS) * drag * speed if power else drag)
    return np.stack([np.broadcast_to(row, speed.shape) for row in rows], axis=1)


def _viscosity_change(
    sound: SoundUnit, effects: Sequence[Any], points: Points
) -> Array:
    """Return viscosity / that of the sound unit at the same points, shape (n,)."""
    ratio = np.ones_like(points[SPEED.name])
    within = sound.within_temperatures(points)
    for effect in effects:
        if isinstance(effect, UnreadOilTemperature):
            ratio = ratio * effect.viscosity_ratio(ratio)
        elif isinstance(effect, OilTemperature):
            before = effect.viscosity_ratio(within[OIL_TEMPERATURE.name])
            after = effect.viscosity_ratio(points[OIL_TEMPERATURE.name])
            ratio = ratio * np.asarray(after) / np.asarray(before)
    return np.asarray(ratio)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the bench itself: zero and gain of the torque meters and of the pressure gauge."""

from dataclasses import dataclass

from .base import Array, Effect, ShaftState, size


class _TorqueMeter(Effect):
    name = "torque_sensor"
    component = "sensor"
    source = "paper, section 2.2: meter error up to 10 N m; 0.12 % systematic"
    remedy = (
        "check the meter's zero before and after the campaign; calibrate it with a dead "
        "weight"
    )


@dataclass(frozen=True)
class EngineTorqueZero(_TorqueMeter):
    """The engine torque meter reads T + zero."""

    form = "zero of the engine meter"
    shared_error = "zero of the engine meter"
    summary = (
        "the engine torque meter is off by a constant: light loads look wrong most"
    )

    zero: float = size("N m", 3.0, -20.0, 20.0, "reading at no torque")

    def reading(self, efficiency: Array, state: ShaftState) -> Array:
        return efficiency / (
            1.0 + self.zero * efficiency * state.engine_speed / state.load_power
        )


@dataclass(frozen=True)
class EngineTorqueGain(_TorqueMeter):
    """The engine torque meter reads T (1 + gain)."""

    form = "gain of the engine meter"
    shared_error = "gain of the meters"
    summary = "the engine torque meter is off in proportion: every efficiency looks wrong alike"

    gain: float = size("-", 0.012, -0.1, 0.1, "reading / torque - 1")

    def reading(self, efficiency: Array, state: ShaftState) -> Array:
        return efficiency / (1.0 + self.gain)


@dataclass(frozen=True)
class OutputTorqueZero(_TorqueMeter):
    """The output torque meter reads T + zero."""

    form = "zero of the output meter"
    shared_error = "zero of the output meter"
    summary = (
        "the output torque meter is off by a constant: light loads look wrong most"
    )

    zero: float = size("N m", 3.0, -20.0, 20.0, "reading at no torque")

    def true_load_power(self, load_power: Array, output_speed: Array) -> Array:
        return load_power - self.zero * output_speed


@dataclass(frozen=True)
class OutputTorqueGain(_TorqueMeter):
    """The output torque meter reads T (1 + gain)."""

    form = "gain of the output meter"
    shared_error = "gain of the meters"
    summary = "the output torque meter is off in proportion: every efficiency looks wrong alike"

    gain: float = size("-", 0.012, -0.1, 0.1, "reading / torque - 1")

    def true_load_power(self, load_power: Array, output_speed: Array) -> Array:
        return load_power / (1.0 + self.gain)


class _PressureGauge(Effect):
    name = "pressure_sensor"
    component = "sensor"
    source = "ISO 4409, classes A to C: 0.5 to 2.5 % of pressure; effective displacement: ISO 8426"
    remedy = (
        "check the gauge's zero with the unit at rest, and the motor's displacement"
    )


@dataclass(frozen=True)
class PressureZero(_PressureGauge):
    """The pressure gauge reads p + zero."""

    form = "zero"
    summary = (
        "the pressure is off by a constant: a zero, or the low side is not taken off"
    )

    zero: float = size("Pa", 3e5, -4e6, 4e6, "reading at no pressure")

    def pressure_reading(self, pressure: Array) -> Array:
        return pressure + self.zero


@dataclass(frozen=True)
class PressureGain(_PressureGauge):
    """The pressure gauge reads p (1 + gain); a motor of another displacement looks the same."""

    form = "gain"
    summary = "the pressure is off in proportion: its gauge, or a displacement other than stated"

    gain: float = size("-", 0.03, -0.5, 1.0, "reading / pressure - 1")

    def pressure_reading(self, pressure: Array) -> Array:
        return pressure * (1.0 + self.gain)


@dataclass(frozen=True)
class ReferenceDisplacement(Effect):
    """True displacement = stated (1 - excess): an error of the losses, not of the unit.

    Flow is lost then in proportion to speed, also without pressure, and the same part of the
    pressure torque is gained.
    """

    unit_only = True
    name = "reference_displacement"
    component = "sensor"
    summary = (
        "the displacement by which the losses are reckoned is not that of the unit"
    )
    source = "derived capacity: ISO 8426; Toet et al., Energies 2019, 12, 415"
    remedy = "measure the flow near no pressure at several speeds (ISO 8426)"

    excess: float = size("-", 0.01, -0.1, 0.1, "stated / true displacement - 1")

    def true_displacement_ratio(self, displacement_ratio: Array) -> Array:
        return displacement_ratio * (1.0 - self.excess)

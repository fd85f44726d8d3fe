# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Errors of the bench itself: zero and gain of the torque meters."""

from __future__ import annotations

from dataclasses import dataclass

from .base import Array, Effect, ShaftState, size


class _TorqueMeter(Effect):
    name = "torque_sensor"
    component = "sensor"
    source = "paper, section 2.2: meter error up to 10 N m; 0.12 % systematic"
    remedy = ("check the meter's zero before and after the campaign; calibrate it with a dead "
              "weight")


@dataclass(frozen=True)
class EngineTorqueZero(_TorqueMeter):
    """The engine torque meter reads T + zero."""

    form = "zero of the engine meter"
    summary = "the engine torque meter is off by a constant: light loads look wrong most"

    zero: float = size("N m", 3.0, -20.0, 20.0, "reading at no torque")

    def reading(self, efficiency: Array, state: ShaftState) -> Array:
        return efficiency / (1.0 + self.zero * efficiency * state.engine_speed / state.load_power)


@dataclass(frozen=True)
class EngineTorqueGain(_TorqueMeter):
    """The engine torque meter reads T (1 + gain)."""

    form = "gain of the engine meter"
    summary = "the engine torque meter is off in proportion: every efficiency looks wrong alike"

    gain: float = size("-", 0.012, -0.1, 0.1, "reading / torque - 1")

    def reading(self, efficiency: Array, state: ShaftState) -> Array:
        return efficiency / (1.0 + self.gain)


@dataclass(frozen=True)
class OutputTorqueZero(_TorqueMeter):
    """The output torque meter reads T + zero."""

    form = "zero of the output meter"
    summary = "the output torque meter is off by a constant: light loads look wrong most"

    zero: float = size("N m", 3.0, -20.0, 20.0, "reading at no torque")

    def true_load_power(self, load_power: Array, output_speed: Array) -> Array:
        return load_power - self.zero * output_speed


@dataclass(frozen=True)
class OutputTorqueGain(_TorqueMeter):
    """The output torque meter reads T (1 + gain)."""

    form = "gain of the output meter"
    summary = "the output torque meter is off in proportion: every efficiency looks wrong alike"

    gain: float = size("-", 0.012, -0.1, 0.1, "reading / torque - 1")

    def true_load_power(self, load_power: Array, output_speed: Array) -> Array:
        return load_power / (1.0 + self.gain)

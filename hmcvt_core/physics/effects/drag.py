# SPDX-License-Identifier: Apache-2.0
"""Torques that drag a shaft whatever the load: charge pump, bearings, churning, open clutches."""

from __future__ import annotations

from dataclasses import dataclass

from .base import Effect, ShaftState, Value, shape, size

_ENGINE_REFERENCE = 150.0  # rad/s, mid speed of the paper's engine: sizes are stated there
_OUTPUT_REFERENCE = 180.0  # rad/s, the same at the output of HM4


@dataclass(frozen=True)
class ChargePump(Effect):
    """T = p_c V_c / efficiency: relief pressure times charge displacement, independent of load."""

    name = "charge_pump"
    component = "pump"
    summary = ("the charge pump takes a nearly constant torque, so light loads lose most; the "
               "base model books it as pump damping")
    source = "charge pressure 15 to 21 bar, closed-circuit practice; T = p V / efficiency"
    remedy = "measure charge pressure and flow, or the pump shaft torque"

    torque: float = size("N m", 4.0, 0.0, 25.0, "torque on the pump shaft")

    def pump_drag(self, state: ShaftState) -> Value:
        return self.torque


@dataclass(frozen=True)
class BearingDrag(Effect):
    """M0 of Palmgren: constant seal friction is the exponent 0, lubricated bearings 2/3."""

    name = "bearing_drag"
    component = "gears"
    summary = "bearings and seals on the engine side drag with a torque that hardly minds the load"
    source = "Palmgren M0 ~ (nu n)^(2/3); SKF four-source friction model"
    remedy = "spin the transmission without load and without charge pressure"
    prior = 0.15

    torque: float = size("N m", 3.0, 0.0, 20.0, "drag torque on the engine shaft at 150 rad/s")
    exponent: float = shape("-", (0.0, 0.67), "power of speed in the torque")

    def engine_drag(self, state: ShaftState) -> Value:
        return self.torque * (state.engine_speed / _ENGINE_REFERENCE) ** self.exponent


@dataclass(frozen=True)
class Churning(Effect):
    """P = k w^n: oil churning and windage of the engine-side gears, n = 2.5 to 3."""

    name = "churning"
    component = "gears"
    summary = "engine-side gears churn oil: the loss grows with nearly the cube of engine speed"
    source = "Changenet & Velex 2007; tractor DCT test: Agriculture 2023, 13, 1225"
    remedy = "repeat one point at lowered oil level"

    torque: float = size("N m", 6.0, 0.0, 60.0, "drag torque on the engine shaft at 150 rad/s")
    exponent: float = shape("-", (1.5, 1.75, 2.0), "power of speed in the torque")

    def engine_drag(self, state: ShaftState) -> Value:
        return self.torque * (state.engine_speed / _ENGINE_REFERENCE) ** self.exponent


@dataclass(frozen=True)
class OutputChurning(Effect):
    """P = k w^n at the output shaft, n = 2.5 to 3."""

    name = "output_churning"
    component = "gears"
    summary = ("output-side gears churn oil: the loss grows with nearly the cube of output speed, "
               "so it rises with the displacement ratio")
    source = "Changenet & Velex 2007"
    remedy = "repeat one point at lowered oil level"
    prior = 0.15

    torque: float = size("N m", 3.0, 0.0, 40.0, "drag torque on the output shaft at 180 rad/s")
    exponent: float = shape("-", (1.5, 1.75, 2.0), "power of speed in the torque")

    def output_drag(self, state: ShaftState) -> Value:
        return self.torque * (state.output_speed / _OUTPUT_REFERENCE) ** self.exponent


@dataclass(frozen=True)
class ClutchDrag(Effect):
    """T = T_peak 2 x / (1 + x^2), x = slip speed / speed of the peak.

    The film shears (torque rises with slip), then breaks (it falls). The slip of the open clutches
    follows the output shaft.
    """

    name = "clutch_drag"
    component = "clutches"
    summary = ("open wet clutches drag on the output side: the torque rises with slip, peaks and "
               "falls as the oil film breaks")
    source = "Iqbal et al. 2013; review: Lubricants 2025, 13, 27"
    remedy = "spin the output side alone with the clutches open"

    torque: float = size("N m", 6.0, 0.0, 40.0, "drag torque at its peak")
    peak_speed: float = shape("rad/s", (60.0, 90.0, 130.0, 180.0, 260.0),
                              "output speed at the peak")

    def output_drag(self, state: ShaftState) -> Value:
        x = state.output_speed / self.peak_speed
        return self.torque * 2.0 * x / (1.0 + x * x)

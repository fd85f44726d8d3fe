# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""An independent solver of the steady state: bisection on the power balance of the shafts.

Nothing of `hmcvt_core` is used but the numbers that a stage holds. At an assumed output speed every
other speed follows from the gears, the pressure from the flow, and the torques from the pressure;
the steady state is where the power that reaches the output is that of the load.

The rule for the branch: without load the output runs at the speed at which no torque is left. A
load slows the output in this sense, and overrun speeds it up, until the powers agree. A load that
is greater than the first maximum of the power on this way is not carried. A unit on the planetary
row that friction holds at rest is a jump of the torque, and a jump may carry the load.
"""

from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np

_BISECTIONS = 110
_NARROWINGS = 90
_DOUBLINGS = 60
_BESIDE_REST = 1e-9
"""Distance from a unit at rest, against the speed there, at which a slope is taken."""


class State(NamedTuple):
    """Arrays of shape (n,); NaN without a steady state.

    Attributes:
        output_speed: [rad/s].
        engine_torque: [N m].
        margin: distance of the load from the most that is carried, against that power [-];
            infinite where there is no such limit.
    """

    output_speed: np.ndarray
    engine_torque: np.ndarray
    margin: np.ndarray


class Shafts(NamedTuple):
    """Torques at one assumed output speed [N m] and speeds [rad/s]."""

    output_torque: np.ndarray
    engine_torque: np.ndarray


def geared(torque, speed, efficiency):
    """Torque behind gears, against the direction in which the power enters."""
    return torque * np.where(torque * speed > 0.0, efficiency, 1.0 / efficiency)


@dataclass
class Balance:
    """One stage at points of shape (n,)."""

    stage: object
    parameters: object
    stroke: np.ndarray
    engine_speed: np.ndarray
    load_torque: np.ndarray

    def __post_init__(self):
        stage = self.stage
        k = stage.planetary_constant
        self.row = {"sun": 1.0, "ring": k, "carrier": -1.0 - k}
        paths = ("mechanical", "pump", "motor", "output")
        self.ratio = {}
        self.gears = {}
        for name in paths:
            path = getattr(stage, name)
            self.ratio[name] = path.direction * prod(
                pair.ratio for pair in path.gear_pairs
            )
            self.gears[name] = prod(pair.efficiency for pair in path.gear_pairs)
        self.load_power = self.load_torque * self.engine_speed

    def third_member(self, output_speed):
        """Speed of the member of the row that a hydraulic unit is on."""
        stage = self.stage
        engine = self.row[stage.mechanical_member] * (
            self.engine_speed / self.ratio["mechanical"]
        )
        output = self.row[stage.output_member] * output_speed * self.ratio["output"]
        return -(engine + output) / self.row[stage.motor_member]

    def speeds(self, output_speed):
        """Speeds of pump and motor."""
        if self.stage.layout == "output_coupled":
            pump = self.pump_sense() * self.third_member(output_speed)
            motor = output_speed * self.ratio["motor"]
            return pump / self.ratio["pump"], motor
        pump = self.engine_speed / self.ratio["pump"] + 0.0 * output_speed
        if self.stage.layout == "hydrostatic":
            return pump, output_speed * self.ratio["output"] * self.ratio["motor"]
        return pump, self.third_member(output_speed) * self.ratio["motor"]

    def pump_sense(self):
        """Sense in which the engine turns the pump while the output stands."""
        return np.sign(self.third_member(np.zeros_like(self.engine_speed)))

    def pressure(self, pump, motor):
        units = self.stage.pump_motor
        flow = units.pump_displacement * self.stroke * pump
        flow = flow - units.motor_displacement * motor
        return flow / self.parameters.leakage

    def motor_torque(self, pressure, motor, sense):
        """Torque that the motor gives to its gears, behind them."""
        units = self.stage.pump_motor
        ideal = pressure * units.motor_displacement
        torque = ideal - sense * units.motor_friction * np.abs(ideal)
        torque = torque - self.parameters.motor_damping * motor
        return geared(torque, sense, self.gears["motor"]) * self.ratio["motor"]

    def pump_torque(self, pressure, pump, sense):
        """Torque that the pump takes, before its gears."""
        units = self.stage.pump_motor
        ideal = pressure * self.stroke * units.pump_displacement
        torque = ideal + sense * units.pump_friction * np.abs(ideal)
        torque = torque + self.parameters.pump_damping * pump
        return -geared(-torque, sense, self.gears["pump"]) / self.ratio["pump"]

    def shafts(self, output_speed, motor_sense=None, pump_sense=None, load=None):
        """Torques at an output speed.

        Args:
            output_speed: assumed [rad/s].
            motor_sense: direction of the friction of the motor, if not that of its speed.
            pump_sense: the same of the pump.
            load: output torque, where a unit at rest takes what is left of it.
        """
        stage = self.stage
        pump, motor = self.speeds(output_speed)
        if motor_sense is None:
            motor_sense = np.sign(motor)
        if pump_sense is None:
            pump_sense = np.sign(pump)
        pressure = self.pressure(pump, motor)
        from_motor = self.motor_torque(pressure, motor, motor_sense)
        to_pump = self.pump_torque(pressure, pump, pump_sense)
        output_member_speed = output_speed * self.ratio["output"]
        if stage.layout == "hydrostatic":
            output = self.to_output(from_motor, output_member_speed)
            return Shafts(output, to_pump)
        if stage.layout == "input_coupled":
            share = from_motor / self.row[stage.motor_member]
            given = -share * self.row[stage.output_member]
            output = self.to_output(given, output_member_speed)
            if load is not None:
                share = self.share_of(load, output_member_speed)
            return Shafts(output, to_pump + self.from_engine(share))
        share = -self.pump_sense() * to_pump / self.row[stage.motor_member]
        given = -share * self.row[stage.output_member]
        output = from_motor + self.to_output(given, output_member_speed)
        if load is not None:
            share = self.share_of(load - from_motor, output_member_speed)
        return Shafts(output, self.from_engine(share))

    def to_output(self, torque, speed):
        return geared(torque, speed, self.gears["output"]) * self.ratio["output"]

    def share_of(self, output_torque, speed):
        """Torque of the row, per coefficient, that gives an output torque."""
        torque = output_torque / self.ratio["output"]
        takes = torque * speed > 0.0
        eta = self.gears["output"]
        given = torque * np.where(takes, 1.0 / eta, eta)
        return -given / self.row[self.stage.output_member]

    def from_engine(self, share):
        """Torque that the engine gives to the mechanical path."""
        taken = share * self.row[self.stage.mechanical_member]
        member_speed = self.engine_speed / self.ratio["mechanical"]
        torque = -geared(-taken, member_speed, self.gears["mechanical"])
        return torque / self.ratio["mechanical"]

    # --- the branch ------------------------------------------------------------------------------

    def without_load(self):
        """Output speed without load; NaN where the torque does not fall with the speed."""
        size = np.maximum(self.engine_speed, 1.0)
        for _ in range(_DOUBLINGS):
            is_wide = (self.shafts(-size).output_torque > 0.0) & (
                self.shafts(size).output_torque < 0.0
            )
            size = np.where(is_wide, size, 2.0 * size)
        speed = self.crossing(
            lambda speed: self.shafts(speed).output_torque, -size, size
        )
        speed = np.where(np.abs(speed) < 1e-20 * self.engine_speed, 0.0, speed)
        return np.where(is_wide, speed, np.nan)

    @staticmethod
    def crossing(function, positive_end, negative_end):
        """Bisect between ends at which a function is positive and negative."""
        for _ in range(_BISECTIONS):
            middle = 0.5 * (positive_end + negative_end)
            is_positive = function(middle) > 0.0
            positive_end = np.where(is_positive, middle, positive_end)
            negative_end = np.where(is_positive, negative_end, middle)
        return 0.5 * (positive_end + negative_end)

    def power(self, speed):
        return self.shafts(speed).output_torque * speed

    def maximum(self, low, high):
        """Speed of the greatest power between two speeds, by thirds."""
        for _ in range(_NARROWINGS):
            third = (high - low) / 3.0
            left, right = low + third, high - third
            is_left = self.power(left) > self.power(right)
            high = np.where(is_left, right, high)
            low = np.where(is_left, low, left)
        return 0.5 * (low + high)

    def resting_speed(self):
        """Output speed at which the unit on the row stands; NaN without a row."""
        if self.stage.layout == "hydrostatic":
            return np.full_like(self.engine_speed, np.nan)
        still = self.third_member(np.zeros_like(self.engine_speed))
        slope = self.third_member(np.ones_like(self.engine_speed)) - still
        return -still / slope

    def solve(self):
        start = self.without_load()
        sense = np.sign(start)
        rest = self.resting_speed()
        rest = np.where(rest * sense > 0.0, rest, np.nan)
        speed, margin = self.pulled(start, rest)
        faster = self.overrun(start)
        speed = np.where(self.load_power > 0.0, speed, faster)
        margin = np.where(self.load_power > 0.0, margin, np.inf)
        idle = self.load_power == 0.0
        speed = np.where(idle, start, speed)
        speed = np.where((start == 0.0) & ~idle, np.nan, speed)
        if self.stage.layout == "output_coupled":
            speed = np.where(self.beyond_pole(), np.nan, speed)
        return State(speed, self.engine_torque(speed), margin)

    def pulled(self, start, rest):
        """Speed under a load that slows the output; and how far the load is from the most."""
        # Closer to rest than a slope is taken, the unit rests from the start.
        is_slower = np.abs(rest) < np.abs(start) * (1.0 - _BESIDE_REST)
        nearest = np.where(is_slower, rest, 0.0)
        speed, peak, at_end = self.in_segment(start, nearest, start)
        most = peak
        # Beyond the unit at rest the branch goes on only if the power rises up to there.
        below = nearest * (1.0 - _BESIDE_REST)
        goes_on = np.isnan(speed) & at_end & (nearest != 0.0)
        jump = self.power(below)
        held = goes_on & (self.load_power <= jump)
        slower, lower_peak, _ = self.in_segment(below, np.zeros_like(rest), start)
        speed = np.where(held, nearest, np.where(goes_on, slower, speed))
        most = np.where(goes_on, np.fmax(jump, lower_peak), most)
        margin = np.abs(self.load_power - most) / np.abs(most)
        first = np.abs(self.load_power - peak) / np.abs(peak)
        return speed, np.fmin(margin, first)

    def in_segment(self, fast, slow, start):
        """Speed between two speeds, the power of the maximum, and whether that is the slow end."""
        slow_end = slow + _BESIDE_REST * (fast - slow) * (slow != 0.0)
        top = self.maximum(slow_end, fast)
        peak = self.power(top)
        at_end = np.abs(top - slow_end) < 1e-6 * np.abs(fast - slow)
        speed = self.crossing(
            lambda speed: self.power(speed) - self.load_power, top, fast
        )
        return np.where(self.load_power <= peak, speed, np.nan), peak, at_end

    def overrun(self, start):
        """Speed at which the wheels drive the output with a power."""
        fast = 2.0 * start
        for _ in range(_DOUBLINGS):
            is_wide = self.power(fast) < self.load_power
            fast = np.where(is_wide, fast, 2.0 * fast)
        speed = self.crossing(
            lambda speed: self.power(speed) - self.load_power, start, fast
        )
        return np.where(is_wide, speed, np.nan)

    def engine_torque(self, speed):
        """Torque of the engine; a unit of the row at rest takes what the load leaves."""
        stands = speed == 0.0
        load = np.where(stands, 0.0, self.load_power / np.where(stands, 1.0, speed))
        by_load = self.shafts(speed, load=load).engine_torque
        if self.stage.layout != "output_coupled":
            return by_load
        by_pump = self.shafts(speed).engine_torque
        return np.where(self.pump_rests(speed), by_load, by_pump)

    def pump_rests(self, speed):
        """Whether friction holds the pump of an output-coupled stage at rest."""
        pump, _ = self.speeds(speed)
        return np.abs(pump) < 1e-12 * self.engine_speed

    def may_be_refused(self, speed):
        """Whether a model may refuse this state, as docs/theory.md says: a unit on the row rests.

        In overrun this is the pump of an output-coupled stage. Under a load that is stated as
        power it is the motor of an input-coupled stage, after the output has slowed down to it.
        """
        if self.stage.layout == "output_coupled":
            return self.pump_rests(speed)
        is_slowed = np.abs(speed) <= np.abs(self.resting_speed()) * (1.0 + 1e-9)
        return is_slowed & (self.load_power > 0.0)

    def beyond_pole(self):
        """Whether the row feeds back at least the flow that the motor takes."""
        still, moving = (
            np.zeros_like(self.engine_speed),
            np.ones_like(self.engine_speed),
        )
        fed_back = self.speeds(moving)[0] - self.speeds(still)[0]
        taken = self.speeds(moving)[1]
        units = self.stage.pump_motor
        fed_back = fed_back * self.stroke * units.pump_displacement
        return fed_back / (taken * units.motor_displacement) >= 1.0

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Gear trains of the stages on the bench: paths, planetary row, and speeds by Willis.

Speeds of the motor are counted positive where the motor speeds the output up. The displacement
ratio that the bench commands has the sense of the motor shaft; `sense` converts one to the other.
"""

from dataclasses import dataclass
from functools import cached_property
from math import pi, prod

from studies.blind.effect import FloatArray

#: One cubic centimetre per revolution, in m3/rad.
CM3_PER_REV = 1e-6 / (2.0 * pi)

#: Gear pairs of Table 1 of the paper: driving speed / driven speed.
_PAPER = {
    1: 1.439,
    2: 0.969,
    3: 1.484,
    4: 0.678,
    5: 1.96,
    6: 0.982,
    9: 0.794,
    11: 0.823,
    12: 1.093,
}


@dataclass(frozen=True)
class GearPath:
    """Gear pairs in series from the engine side to the output side.

    Attributes:
        ratios: speed of the driving gear / speed of the driven gear, of each pair [-].
        efficiency: part of the power that each pair passes on [-].
        direction: sense of the last shaft against the first, 1 or -1.
        labels: number by which an effect knows each pair.
    """

    ratios: tuple[float, ...]
    efficiency: float
    direction: int = 1
    labels: tuple[int, ...] = (2,)

    @cached_property
    def ratio(self) -> float:
        """Speed of the first shaft / speed of the last, without sign [-]."""
        return prod(self.ratios)


@dataclass(frozen=True)
class Train:
    """One stage with its planetary row and its pair of units.

    Attributes:
        name: of the stage.
        pump_on_row: True for an output-coupled stage (the row drives the pump, the motor is geared
            to the output), False for an input-coupled one.
        ring_ratio: teeth of the ring / teeth of the sun [-].
        mechanical, pump, motor, output: paths; the output path begins at the row.
        mechanical_member, hydraulic_member, output_member: what each path meets at the row.
        pump_displacement, motor_displacement: [m3/rad].
        friction: friction torque / pressure torque of either unit [-].
    """

    name: str
    pump_on_row: bool
    ring_ratio: float
    mechanical: GearPath
    mechanical_member: str
    pump: GearPath
    motor: GearPath
    hydraulic_member: str
    output: GearPath
    output_member: str
    pump_displacement: float
    motor_displacement: float
    friction: float = 0.01

    @cached_property
    def willis(self) -> dict[str, float]:
        """Coefficients of the members: the sum of coefficient x speed vanishes."""
        k = self.ring_ratio
        return {"sun": 1.0, "ring": k, "carrier": -(1.0 + k)}

    @cached_property
    def mechanical_share(self) -> float:
        """Output speed per engine speed while the hydraulic member stands still [-]."""
        row = -self.willis[self.mechanical_member] / self.willis[self.output_member]
        direction = self.mechanical.direction * self.output.direction
        return direction * row / (self.mechanical.ratio * self.output.ratio)

    @cached_property
    def _motor_share(self) -> float:
        """Output speed per motor speed, with the sign of the motor shaft [-]."""
        if self.pump_on_row:
            return self.motor.direction / self.motor.ratio
        row = -self.willis[self.hydraulic_member] / self.willis[self.output_member]
        direction = self.motor.direction * self.output.direction
        return direction * row / (self.motor.ratio * self.output.ratio)

    @cached_property
    def sense(self) -> float:
        """Sign of the output speed that a positive motor speed adds."""
        return 1.0 if self._motor_share > 0.0 else -1.0

    @cached_property
    def motor_share(self) -> float:
        """Output speed that one rad/s of the motor adds [-], positive."""
        return abs(self._motor_share)

    def output_speed(
        self, engine_speed: FloatArray, motor_speed: FloatArray, slip: FloatArray
    ) -> FloatArray:
        """Speed of the output shaft [rad/s]; `slip` is that of the mechanical path."""
        moved = self.motor_share * motor_speed
        if self.pump_on_row:
            return moved
        return self.mechanical_share * engine_speed * (1.0 - slip) + moved

    def members(
        self, engine_speed: FloatArray, output_speed: FloatArray, slip: FloatArray
    ) -> dict[str, FloatArray]:
        """Speeds of sun, ring and carrier [rad/s]."""
        mechanical = self.mechanical.direction * engine_speed / self.mechanical.ratio
        speeds = {
            self.mechanical_member: mechanical * (1.0 - slip),
            self.output_member: self.output.direction
            * output_speed
            * self.output.ratio,
        }
        weighted = 0.0 * engine_speed
        for member, speed in speeds.items():
            weighted = weighted + self.willis[member] * speed
        speeds[self.hydraulic_member] = -weighted / self.willis[self.hydraulic_member]
        return speeds

    @cached_property
    def pump_sense(self) -> float:
        """Sense in which the engine turns the row member of the pump, output at rest."""
        ratio = (
            -self.willis[self.mechanical_member] / self.willis[self.hydraulic_member]
        )
        return self.mechanical.direction * (1.0 if ratio > 0.0 else -1.0)

    def pump_speed(
        self, engine_speed: FloatArray, members: dict[str, FloatArray]
    ) -> FloatArray:
        """Speed of the pump [rad/s], positive as the engine turns it."""
        if self.pump_on_row:
            return self.pump_sense * members[self.hydraulic_member] / self.pump.ratio
        return engine_speed / self.pump.ratio


def _paper_stage(
    name: str,
    ring_ratio: float,
    mechanical: tuple[int, ...],
    mechanical_member: str,
    output: tuple[int, ...],
    output_member: str,
) -> Train:
    """Return an input-coupled stage of the paper's gear train."""
    outputs = tuple(_PAPER[pair] for pair in output)
    return Train(
        name=name,
        pump_on_row=False,
        ring_ratio=ring_ratio,
        mechanical=GearPath(
            tuple(_PAPER[pair] for pair in mechanical), 0.98, 1, (2, 3)
        ),
        mechanical_member=mechanical_member,
        pump=GearPath((_PAPER[4],), 0.98, 1, (4,)),
        motor=GearPath((_PAPER[5],), 0.98, -1, (5,)),
        hydraulic_member="sun",
        output=GearPath(outputs, 0.98, 1, (6, 11, 6)),
        output_member=output_member,
        pump_displacement=55.0 * CM3_PER_REV,
        motor_displacement=55.0 * CM3_PER_REV,
    )


HM4 = _paper_stage("HM4", 2.56, (2, 3), "carrier", (6, 11), "ring")
HM3 = _paper_stage("HM3", 3.56, (1,), "ring", (6, 9, 12), "carrier")
#: The shipped example of an output-coupled transmission, forward.
FORWARD = Train(
    name="forward",
    pump_on_row=True,
    ring_ratio=2.0,
    mechanical=GearPath((1.0,), 0.985),
    mechanical_member="carrier",
    pump=GearPath((0.75,), 0.985, 1, (4,)),
    motor=GearPath((0.6667,), 0.985, 1, (5,)),
    hydraulic_member="ring",
    output=GearPath((1.0,), 0.985, 1, (6,)),
    output_member="sun",
    pump_displacement=90.0 * CM3_PER_REV,
    motor_displacement=180.0 * CM3_PER_REV,
)

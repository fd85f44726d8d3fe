# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The published formulation: eqs (4)-(18) as the paper prints them, guarded.

Readings (the paper is silent or misprints; `docs/theory.md` argues each):

* i_HM inside (8) and (12) is n_e / n_out, the reciprocal of (5).
* Load torque is referred to the engine shaft, so T_out = T_load n_e / n_out.
* Viscous torques in (6), (14), (15) follow sign(eps), and |eta_H| of (16) is taken.
* At eps = 0, eta_H is "any nonzero positive < 1e-4" (section 4.2).

The formulas have a pole inside the working range: the denominator of (11) vanishes for one or two
eps of small size. They are therefore never served unguarded: where their own quantities contradict
each other (a share a_1 against the sign of e_H, an efficiency outside (0, 1)) the answer is NaN.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..transmission.parameters import Parameters
from ..transmission.ranges import Array, OperatingPoints, Solution
from ..transmission.stage import Stage, member_speed_coefficients, speed_ratio

STANDING_EFFICIENCY = 5e-5
"""eta_H taken at eps = 0, inside the paper's (0, 1e-4)."""


class PublishedEfficiency(NamedTuple):
    """Efficiencies of eqs (7)-(18); arrays of one shape, unguarded.

    Attributes:
        hydraulic: eta_H, pump-motor pair (16).
        split_ratio: e_H, hydraulic share of the ring power (8).
        engine_share: a_1, hydraulic share of the engine power (11).
        mechanical_in: eta_M1, engine to row (7).
        row: eta_HM, planetary row (12).
        total: eta_total, with eta_M2 from row to output (17), (18).
    """

    hydraulic: Array
    split_ratio: Array
    engine_share: Array
    mechanical_in: Array
    row: Array
    total: Array


def hydraulic_split_ratio(stage: Stage, displacement_ratio: Array) -> Array:
    """e_H of eq. (8) with the overall ratio i_HM, as printed [-]."""
    return 1.0 - 1.0 / (speed_ratio(stage, displacement_ratio) * _connection(stage))


def _connection(stage: Stage) -> float:
    """1 + A of eq. (8): speed of the mechanical member / speed of the output member [-].

    With the motor at rest; k / (1 + k) for carrier and ring, the paper's case.
    """
    coefficients = member_speed_coefficients(stage.planetary_constant)
    return abs(
        coefficients[stage.output_member] / coefficients[stage.mechanical_member]
    )


@np.errstate(divide="ignore", invalid="ignore")
def hydraulic_efficiency(
    stage: Stage, parameters: Parameters, points: OperatingPoints
) -> Array:
    """|eta_H| of the pump-motor pair, eqs (6), (13)-(16) in the steady state [-].

    NaN where leakage turns the motor against its stroke.
    """
    units = stage.pump_motor
    # Positive where the motor adds to the output speed, as (6) has it.
    stroke = points.displacement_ratio * np.sign(stage.motor_speed_ratio)
    sign = np.sign(stroke)
    output_torque = points.load_torque / speed_ratio(stage, points.displacement_ratio)
    pump_speed = points.engine_speed / stage.pump.ratio
    v_m, v_p = units.motor_displacement, units.pump_displacement
    ideal_speed = stroke * pump_speed * v_p / v_m
    load = output_torque * abs(stage.motor_speed_ratio)
    pressure = (load + parameters.motor_damping * ideal_speed) / v_m  # Eq. (6)
    motor_speed = ideal_speed - parameters.leakage * pressure / v_m  # Eq. (13)
    motor_torque = (
        pressure * v_m * (1.0 - units.motor_friction)
        - parameters.motor_damping * motor_speed
    )  # Eq. (14)
    pump_torque = (
        pressure * v_p * stroke * (1.0 - units.pump_friction)
        + sign * parameters.pump_damping * pump_speed
    )  # Eq. (15)
    ratio = np.abs(motor_speed * motor_torque / (pump_speed * pump_torque))  # Eq. (16)
    turned = motor_speed * sign < 0.0
    return np.where(sign == 0.0, STANDING_EFFICIENCY, np.where(turned, np.nan, ratio))


@np.errstate(divide="ignore", invalid="ignore")
def efficiencies(
    stage: Stage, displacement_ratio: Array, hydraulic: Array
) -> PublishedEfficiency:
    """Eqs (7)-(12), (17), (18) for a given eta_H, unguarded: they pass through the pole of (11).

    `hydraulic` broadcasts against `displacement_ratio`; all [-].
    """
    tandem = hydraulic * stage.pump.efficiency * stage.motor.efficiency  # eta'_H
    i_hm = 1.0 / speed_ratio(stage, displacement_ratio)
    split = hydraulic_split_ratio(stage, displacement_ratio)
    r = _connection(stage) / i_hm
    gears_in = stage.mechanical.efficiency
    row = np.where(
        split < 0.0, r / (tandem * r - tandem + 1.0), tandem * r / (r + tandem - 1.0)
    )  # Eq. (12)
    share = split / ((1.0 / row - split) / gears_in * tandem + split)  # Eq. (11)
    into = (1.0 - share) * gears_in + share  # Eq. (7)
    total = into * row * stage.output.efficiency  # Eqs (17), (18)
    return PublishedEfficiency(
        np.broadcast_to(hydraulic, total.shape), split, share, into, row, total
    )


def is_consistent(
    values: PublishedEfficiency, displacement_ratio: Array
) -> NDArray[np.bool_]:
    """Return where the formulas agree with themselves.

    Power circulates (e_H < 0) exactly where the hydraulic share a_1 of the engine power is
    negative; beyond the pole of (11) the two contradict. At eps = 0 the paper's convention
    (eta_H -> 0) holds instead.
    """
    sound = (
        (values.total > 0.0)
        & (values.total < 1.0)
        & (values.row > 0.0)
        & (values.row <= 1.0)
        & (values.split_ratio <= 1.0)  # eq. (12) ends there: the output would turn back
        & (values.hydraulic > 0.0)
        & (values.hydraulic < 1.0)
    )
    agrees = (values.engine_share * values.split_ratio >= 0.0) & (
        values.engine_share <= 1.0
    )
    return np.asarray(sound & (agrees | (displacement_ratio == 0.0)))


INCONSISTENT = (
    "the published formulas contradict themselves here (pole of eq. (11), "
    "or an efficiency outside 0 to 1)"
)


class PublishedSolver(NamedTuple):
    """Answers of the published formulas; see `EfficiencyModel` for the attributes."""

    stage: Stage
    parameters: Parameters

    def solve(self, points: OperatingPoints) -> Solution:
        """eta_total of eq. (18), NaN where the formulas contradict themselves; speed of eq. (5)."""
        stroke = points.displacement_ratio
        # An output at rest divides by zero; what comes of it is inconsistent and ends as NaN.
        hydraulic = hydraulic_efficiency(self.stage, self.parameters, points)
        values = efficiencies(self.stage, stroke, hydraulic)
        total = np.where(is_consistent(values, stroke), values.total, np.nan)
        return Solution(
            total,
            points.engine_speed * speed_ratio(self.stage, stroke),
            points.load_torque / total,
        )

    def refusal(
        self, displacement_ratio: float, load_torque: float, engine_torque: float
    ) -> str:
        """Return why there is no efficiency at a point."""
        return INCONSISTENT

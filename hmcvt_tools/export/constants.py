# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The constants of a stage that do not depend on the hydraulic parameters.

The exported code works out the rest at run time, from the parameters as they are calibrated then.
Names are those of `physics.regimes`, which states the equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hmcvt_core.physics.regimes import SIGNS, Quadrant, Regime, Senses
from hmcvt_core.transmission.parameters import Candidates
from hmcvt_core.transmission.stage import Stage, speed_ratio

_UNIT_PARAMETERS = Candidates(leakage=1.0, motor_damping=1.0, pump_damping=1.0)
"""Parameters at which a drag equals the factor that multiplies a damping."""

_DIRECTIONS = {1: "forward", -1: "backward"}
_LOADS = {1: "pull", -1: "overrun"}

_ENGINE_SENSES = (Senses(1, 1), Senses(1, -1), Senses(-1, 1), Senses(-1, -1))
_ROW_SENSES = (Senses(1, 1), Senses(-1, 1))
"""With the pump on the row, the sense of the power reflects nothing."""


@dataclass(frozen=True)
class RegimeFactors:
    """Factors of one regime.

    Attributes:
        name: of the regime in words.
        gear: output torque of the motor per motor torque, alpha [-].
        transmitted: part of the pressure torque that friction leaves, 1 -+ c_fm [-].
        brace: output torque that the pump braces per pump torque, rho [-].
        pump: pump torque per pressure torque, 1 +- c_fp [-].
    """

    name: str
    gear: float
    transmitted: float
    brace: float
    pump: float


@dataclass(frozen=True)
class QuadrantFactors:
    """Factors of one quadrant: sense of the output and of the power.

    Attributes:
        name: the senses in words.
        flow_ratio: e at displacement ratio 1 [-].
        rest: y at which the motor rests, m [-].
        rest_squared: m^2 [-].
        sense: sign of y.
        reflection: sign of what is reflected.
        output_share: z per y, c [-].
        mechanical_load: engine torque per output torque over the mechanical path, G [-].
        regimes: factors of each regime of the layout, in the order of `Regime`.
    """

    name: str
    flow_ratio: float
    rest: float
    rest_squared: float
    sense: float
    reflection: float
    output_share: float
    mechanical_load: float
    regimes: tuple[RegimeFactors, ...]


@dataclass(frozen=True)
class StageFactors:
    """Factors of one stage.

    Attributes:
        name: of the stage.
        paths: the gear pairs of each path in words.
        pump_on_row: whether it is output-coupled.
        reverse: whether the mechanical path drives the output backward.
        engine_share: pump speed per engine speed, a [-].
        output_share: pump speed per output speed, c before reflection [-].
        hydraulic_ratio: output speed per motor speed, h [-].
        displacement_squared: V_m^2 [m6/rad2].
        pump_friction: c_fp [-].
        gears: mean and half the difference of gamma for a driven and for a driving pump [-].
        backward_gears: the same for a pump that turns backward.
        rest_ratio: output speed / engine speed at which the unit on the row stands [-].
        ratio_ends: output speed / engine speed without slip at full stroke, -1 and 1 [-].
        quadrants: output forward and backward; each for pull and for overrun, except with the
            pump on the row.
    """

    name: str
    paths: tuple[str, ...]
    pump_on_row: bool
    reverse: bool
    engine_share: float
    output_share: float
    hydraulic_ratio: float
    displacement_squared: float
    pump_friction: float
    gears: tuple[float, float]
    backward_gears: tuple[float, float]
    rest_ratio: float
    ratio_ends: tuple[float, float]
    quadrants: tuple[QuadrantFactors, ...]


def stage_factors(stage: Stage) -> StageFactors:
    """Return the factors of a stage."""
    first = Quadrant(stage, _UNIT_PARAMETERS)
    senses = _ROW_SENSES if first.pump_on_row else _ENGINE_SENSES
    low, high = speed_ratio(stage, np.array([-1.0, 1.0])).tolist()
    return StageFactors(
        name=stage.name,
        paths=_paths(stage),
        pump_on_row=first.pump_on_row,
        reverse=stage.reverse,
        engine_share=first.pump_ratios[0],
        output_share=stage.pump_speed_ratios[1],
        hydraulic_ratio=first.hydraulic_ratio,
        displacement_squared=stage.pump_motor.motor_displacement**2,
        pump_friction=first.pump_friction,
        gears=first.pump_gears,
        backward_gears=first.backward_gears,
        rest_ratio=stage.mechanical_speed_ratio,
        ratio_ends=(low, high),
        quadrants=_quadrants(stage, senses),
    )


def _paths(stage: Stage) -> tuple[str, ...]:
    """Return which gear pairs each path of a stage has, in words."""
    lines = []
    for name, path in stage.paths.items():
        pairs = []
        for pair in path.gear_pairs:
            pairs.append(
                f"{pair.name} (ratio {pair.ratio:g}, efficiency {pair.efficiency:g})"
            )
        if pairs:
            lines.append(f"{name} path: gear pairs {', '.join(pairs)}")
    return tuple(lines)


def _quadrants(stage: Stage, senses: Sequence[Senses]) -> tuple[QuadrantFactors, ...]:
    quadrants = []
    for sense in senses:
        quadrants.append(_quadrant_factors(stage, sense))
    return tuple(quadrants)


def _quadrant_factors(stage: Stage, senses: Senses) -> QuadrantFactors:
    quadrant = Quadrant(stage, _UNIT_PARAMETERS, senses)
    rest = quadrant.mechanical_ratio
    regimes = []
    for regime in range(len(quadrant.regimes)):
        regimes.append(_regime_factors(stage, quadrant, Regime(regime)))
    name = f"output {_DIRECTIONS[senses.output]}"
    if not quadrant.pump_on_row:
        name = f"{name}, {_LOADS[senses.power]}"
    return QuadrantFactors(
        name=name,
        flow_ratio=float(quadrant.flow_ratio),
        rest=float(rest),
        rest_squared=float(rest**2),
        sense=float(quadrant.sense),
        reflection=float(quadrant.reflection),
        output_share=float(quadrant.pump_ratios[1]),
        mechanical_load=float(quadrant.mechanical_load),
        regimes=tuple(regimes),
    )


def _regime_factors(stage: Stage, quadrant: Quadrant, regime: Regime) -> RegimeFactors:
    constants = quadrant.regimes[regime]
    signs = SIGNS[regime]
    # Friction of the motor on the row takes its sign from the power, else from the pressure.
    sign = signs.pressure if quadrant.pump_on_row else signs.pressure * signs.motor
    return RegimeFactors(
        name=regime.name.lower().replace("_", " "),
        gear=float(constants.motor_drag),
        transmitted=1.0 - stage.pump_motor.motor_friction * sign,
        brace=float(constants.brace),
        pump=float(constants.pump),
    )

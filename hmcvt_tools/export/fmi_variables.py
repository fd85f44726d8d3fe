# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The variables of the FMU: names, kinds, units and start values, for either version of FMI."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.optimum import HYSTERESIS, OUTPUT_POWER
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.parameters import PARAMETER_RANGES
from hmcvt_core.transmission.ranges import Range

from .effect_tables import TABLE_LOAD, TABLE_SPEED

REAL = "real"
INTEGER = "integer"
BOOLEAN = "boolean"


@dataclass(frozen=True)
class Unit:
    """A unit and its exponents in base units.

    Attributes:
        name: as variables state it.
        exponents: of the SI base units and rad, by name.
        display: another unit and what it takes of it, or None.
    """

    name: str
    exponents: tuple[tuple[str, int], ...]
    display: tuple[str, float] | None = None


PLAIN = Unit("1", ())
SECOND = Unit("s", (("s", 1),))
SPEED = Unit("rad/s", (("s", -1), ("rad", 1)), ("r/min", 60.0 / (2.0 * math.pi)))
TORQUE = Unit("N.m", (("kg", 1), ("m", 2), ("s", -2)))
POWER = Unit("W", (("kg", 1), ("m", 2), ("s", -3)), ("kW", 1e-3))
LEAKAGE = Unit("m3/(s.Pa)", (("kg", -1), ("m", 4), ("s", 1)))
DAMPING = Unit("N.m.s/rad", (("kg", 1), ("m", 2), ("s", -1), ("rad", -1)))
UNITS = (PLAIN, SECOND, SPEED, TORQUE, POWER, LEAKAGE, DAMPING)


@dataclass(frozen=True)
class Variable:
    """A variable of the FMU; its value reference is its position in the list.

    Attributes:
        name: of the variable.
        kind: `REAL`, `INTEGER` or `BOOLEAN`.
        causality: `independent`, `input`, `output` or `parameter`.
        description: one line.
        unit: of a real.
        start: start value; None for outputs.
        limits: lowest and highest value, or None.
    """

    name: str
    kind: str
    causality: str
    description: str
    unit: Unit | None = None
    start: float | None = None
    limits: tuple[float, float] | None = None

    @property
    def variability(self) -> str:
        """How the value may change."""
        if self.causality == "parameter":
            return "tunable"
        return "continuous" if self.kind == REAL else "discrete"


# Where every shipped stage has an answer: some simulators stop at a NaN before the first step.
_START_STROKE = 1.0
_START_SPEED = 150.0  # [rad/s]
_START_LOAD = 50.0  # [N m]
_START_OUTPUT_SPEED = 100.0  # [rad/s]
_START_OUTPUT_POWER = 40e3  # [W]
_HYSTERESIS = 0.02  # [-]


def fmu_variables(model: EfficiencyModel, has_tables: bool) -> list[Variable]:
    """Return the variables of a model in the order of their value references.

    Args:
        model: gives stages and parameters.
        has_tables: whether tables of effects limit the inputs.
    """
    return [
        Variable("time", REAL, "independent", "Simulation time", SECOND),
        *_inputs(model, has_tables),
        *_outputs(),
        *_parameters(model),
        # Last: the value references of the variables above stay.
        *_stage_choice(has_tables),
    ]


def _ends(limits: Range) -> tuple[float, float]:
    return limits.low, limits.high


def _inputs(model: EfficiencyModel, has_tables: bool) -> list[Variable]:
    speed = TABLE_SPEED if has_tables else ranges.ENGINE_SPEED
    load = TABLE_LOAD if has_tables else ranges.ANY_LOAD
    stages = ", ".join(f"{i} {name}" for i, name in enumerate(model.stages))
    return [
        Variable(
            "displacement_ratio",
            REAL,
            "input",
            "Pump stroke, a fraction of full stroke",
            PLAIN,
            _START_STROKE,
            _ends(ranges.DISPLACEMENT_RATIO),
        ),
        Variable(
            "engine_speed",
            REAL,
            "input",
            "Speed of the engine",
            SPEED,
            _START_SPEED,
            _ends(speed),
        ),
        Variable(
            "load_torque",
            REAL,
            "input",
            "Output power / engine speed; negative in overrun",
            TORQUE,
            _START_LOAD,
            _ends(load),
        ),
        Variable(
            "stage",
            INTEGER,
            "input",
            f"Stage engaged: {stages}",
            start=0,
            limits=(0, len(model.stages) - 1),
        ),
    ]


def _outputs() -> Sequence[Variable]:
    return (
        Variable(
            "efficiency",
            REAL,
            "output",
            "Output power / engine power; in overrun the reciprocal; NaN without an answer",
            PLAIN,
        ),
        Variable(
            "output_speed",
            REAL,
            "output",
            "Speed of the output shaft, negative backward",
            SPEED,
        ),
        Variable("engine_torque", REAL, "output", "Torque of the engine", TORQUE),
        Variable("power_loss", REAL, "output", "Engine power less output power", POWER),
        Variable(
            "optimal_displacement_ratio",
            REAL,
            "output",
            "Pump stroke of the highest efficiency at this engine speed and load",
            PLAIN,
        ),
        Variable(
            "efficiency_std",
            REAL,
            "output",
            "Standard error of the efficiency from parameters and misfit; NaN where unknown",
            PLAIN,
        ),
        Variable(
            "status",
            INTEGER,
            "output",
            "0 answer, 1 no answer, 2 input out of range, 3 unknown stage",
        ),
        Variable(
            "inside_domain",
            BOOLEAN,
            "output",
            "Whether data of the identification cover the point",
        ),
    )


def _stage_choice(has_tables: bool) -> Sequence[Variable]:
    """Return the demand and the choice of the stage, engaged is the input `stage`."""
    speed = TABLE_SPEED if has_tables else ranges.ENGINE_SPEED
    low, high = ranges.ENGINE_SPEED_LIMITS
    fastest = ranges.OUTPUT_SPEED.high
    return (
        Variable(
            "demanded_output_speed",
            REAL,
            "input",
            "Output speed to hold, negative backward; for optimal_stage",
            SPEED,
            _START_OUTPUT_SPEED,
            (-fastest, fastest),
        ),
        Variable(
            "demanded_output_power",
            REAL,
            "input",
            "Output power to hold; for optimal_stage",
            POWER,
            _START_OUTPUT_POWER,
            _ends(OUTPUT_POWER),
        ),
        Variable(
            "hysteresis",
            REAL,
            "parameter",
            "Part of the engine power that another stage has to save",
            PLAIN,
            _HYSTERESIS,
            _ends(HYSTERESIS),
        ),
        Variable(
            "lowest_engine_speed",
            REAL,
            "parameter",
            "Limit of optimal_engine_speed",
            SPEED,
            low,
            _ends(speed),
        ),
        Variable(
            "highest_engine_speed",
            REAL,
            "parameter",
            "Limit of optimal_engine_speed",
            SPEED,
            high,
            _ends(speed),
        ),
        Variable(
            "optimal_stage",
            INTEGER,
            "output",
            "Stage of the least engine power at the demand; -1 where none holds it",
        ),
        Variable(
            "optimal_engine_speed",
            REAL,
            "output",
            "Its engine speed; NaN where no stage holds the demand",
            SPEED,
        ),
    )


_PARAMETER_WORDS = {
    "leakage": ("Leakage flow per pressure", LEAKAGE),
    "motor_damping": ("Viscous torque per motor speed", DAMPING),
    "pump_damping": ("Viscous torque per pump speed", DAMPING),
}


def _parameters(model: EfficiencyModel) -> list[Variable]:
    variables = []
    for limits in PARAMETER_RANGES:
        words, unit = _PARAMETER_WORDS[limits.name]
        value = getattr(model.parameters, limits.name)
        variables.append(
            Variable(limits.name, REAL, "parameter", words, unit, value, _ends(limits))
        )
    return variables

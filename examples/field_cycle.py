# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Compare the fuel of a field cycle: drive-line optimum against an engine-only rule.

    python examples/field_cycle.py

Both choose stage and engine speed for each part of the cycle; the displacement ratio follows from
the ground speed. The optimum uses the model of the whole drive line. The rule knows the engine
only: it assumes that the transmission passes 80 % everywhere, chooses the engine speed of least
fuel for that power, and the stage with the least stroke at that speed.

The tractor differs from the model: its leakage and dampings are drawn twenty times from the
uncertainty of the identification (params/hm4.yaml). Where a tractor cannot hold a demand, its
engine speeds up. Stages H0 to HM3 are a reading of the paper; engine and cycle are invented. The
result illustrates the method and is no promise.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.model.operating_point import operating_point

TYRE_RADIUS = 0.85  # m
FINAL_DRIVE = 21.0
ASSUMED_EFFICIENCY = 0.8  # of the transmission, by the rule
TORQUE_RESERVE = 0.05
DRAWS = 20
CYCLE = (  # part, s, km/h, kW at the output
    ("ploughing", 600.0, 8.0, 65.0),
    ("headland", 90.0, 5.0, 12.0),
    ("sowing", 400.0, 12.0, 45.0),
    ("mowing", 300.0, 14.0, 35.0),
    ("road, loaded", 300.0, 35.0, 70.0),
    ("road, empty", 200.0, 45.0, 35.0),
)

Choice = tuple[str, float]  # stage, engine speed [rad/s]


def fuel(
    model: hmcvt.EfficiencyModel,
    engine: hmcvt.Engine,
    choice: Choice,
    output_speed: float,
    power: float,
) -> float:
    """Return the fuel rate at a choice [kg/s]; NaN where it cannot hold the demand."""
    stage = model.stages[choice[0]]
    try:
        stroke, load = operating_point(
            stage, choice[1], {"output_speed": output_speed, "output_power": power}
        )
    except hmcvt.InputError:
        return math.nan
    efficiency = stage.efficiency(stroke, choice[1], load)
    return float(engine.fuel_rate(choice[1], load / efficiency))


def driven(
    model: hmcvt.EfficiencyModel,
    engine: hmcvt.Engine,
    choice: Choice,
    output_speed: float,
    power: float,
) -> float:
    """Return the fuel rate at the choice, or at the next engine speed that holds the demand."""
    stage, slowest = choice
    for speed in np.arange(slowest, engine.speed[-1], 2.0).tolist():
        rate = fuel(model, engine, (stage, speed), output_speed, power)
        if math.isfinite(rate):
            return rate
    return math.nan


def by_rule(
    model: hmcvt.EfficiencyModel,
    engine: hmcvt.Engine,
    output_speed: float,
    power: float,
) -> Choice:
    """Return the engine speed of least fuel by the engine alone, and the stage of least stroke."""
    speeds = np.linspace(engine.speed[0], engine.speed[-1], 200)
    torque = power / ASSUMED_EFFICIENCY / speeds
    rates = engine.fuel_rate(speeds, torque)
    rates[torque > (1.0 - TORQUE_RESERVE) * engine.full_load_torque(speeds)] = np.nan
    for speed in speeds[np.argsort(rates)].tolist():  # NaN comes last
        for name in stages_by_stroke(model, speed, output_speed, power):
            if math.isfinite(fuel(model, engine, (name, speed), output_speed, power)):
                return name, speed
    raise SystemExit(f"no stage holds {output_speed:.0f} rad/s at {power / 1e3:.0f} kW")


def stages_by_stroke(
    model: hmcvt.EfficiencyModel, speed: float, output_speed: float, power: float
) -> list[str]:
    """Return the stages that reach the demand at an engine speed, least stroke first."""
    demand = {"output_speed": output_speed, "output_power": power}
    strokes = {}
    for name, stage in model.stages.items():
        with contextlib.suppress(hmcvt.InputError):
            stroke, _ = operating_point(stage, speed, demand)
            strokes[name] = abs(stroke)
    return sorted(strokes, key=strokes.__getitem__)


def drawn(model: hmcvt.EfficiencyModel, seed: int) -> list[hmcvt.EfficiencyModel]:
    """Return the model with parameters drawn from their covariance, positive ones only."""
    known = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    errors = np.array(list(known.standard_errors.values()))
    spread = np.linalg.cholesky(known.correlation)
    rng = np.random.default_rng(seed)
    tractors: list[hmcvt.EfficiencyModel] = []
    while len(tractors) < DRAWS:
        values = known.parameters.to_array() + errors * (spread @ rng.normal(size=3))
        if (values > 1e-13).all():
            parameters = hmcvt.HydraulicParameters(*values.tolist())
            tractors.append(replace(model, parameters=parameters))
    return tractors


def compare(
    tractors: list[hmcvt.EfficiencyModel],
    engine: hmcvt.Engine,
    best: Callable[[float, float], Choice],
) -> None:
    """Print the choices for output speeds and powers, and the fuel of the cycle."""
    used = np.zeros((2, len(tractors)))
    print("part          km/h   kW   optimum            rule               g/s")
    for name, seconds, speed, kilowatts in CYCLE:
        demand = speed / 3.6 / TYRE_RADIUS * FINAL_DRIVE, 1e3 * kilowatts
        choices = best(*demand), by_rule(tractors[0], engine, *demand)
        rates = np.array(
            [
                [driven(tractor, engine, choice, *demand) for tractor in tractors]
                for choice in choices
            ]
        )
        used += seconds * rates
        shown = "   ".join(
            f"{stage:>3} {speed * 30 / math.pi:5.0f} r/min" for stage, speed in choices
        )
        print(
            f"{name:<13} {speed:4.0f} {kilowatts:4.0f}   {shown}   "
            + " ".join(f"{1e3 * rate:.2f}" for rate in rates[:, 0])
        )
    saved, *others = (100.0 * (1.0 - used[0] / used[1])).tolist()
    print(
        f"cycle: {used[0][0]:.2f} kg by the optimum, {used[1][0]:.2f} kg by the rule: "
        f"{saved:.1f} % less on the model itself"
    )
    finite = [saving for saving in others if math.isfinite(saving)]
    if finite:
        low, middle, high = np.quantile(finite, (0.05, 0.5, 0.95))
        print(
            f"on {len(finite)} of {len(others)} drawn tractors, which can drive it at all: "
            f"{middle:.1f} % less (median), 90 % of them {low:.1f} to {high:.1f} %"
        )


def files() -> tuple[hmcvt.EfficiencyModel, hmcvt.Engine]:
    """Read the shipped tractor and its engine."""
    return (
        hmcvt.load_model(hmcvt.data_path("params/tractor.yaml")),
        hmcvt.load_engine(hmcvt.data_path("params/engine.yaml")),
    )


def main() -> None:
    """Compare both choices on the model and on the drawn tractors."""
    model, engine = files()

    def best(output_speed: float, power: float) -> Choice:
        optimum = model.optimal_drive(
            output_speed, power, engine=engine, torque_reserve=TORQUE_RESERVE
        )
        return str(optimum.stage), optimum.engine_speed

    compare([model, *drawn(model, seed=0)], engine, best)


if __name__ == "__main__":
    main()

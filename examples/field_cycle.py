# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A virtual tractor over a field cycle: fuel by the optimum and by an engine-only rule.

    python examples/field_cycle.py

Both choose stage and engine speed for each part of the cycle; the displacement ratio then follows
from the ground speed. The optimum asks the model of the whole drive line. The rule knows the engine
alone: it takes the transmission to pass 80 % everywhere, goes to the engine speed of least fuel for
that power, and takes the stage that needs least stroke there.

The tractor is not the model: its leakage and dampings are drawn from what the identification leaves
open (params/hm4.yaml), twenty times; where one cannot hold what is asked, the engine speeds up.
Stages H0 to HM3 are a reading of the paper, engine and cycle are made up: what comes out is an
example of the method, not a promise.
"""

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.model.agreement import operating_point

TYRE_RADIUS, FINAL_DRIVE = 0.85, 21.0  # m, -
ASSUMED = 0.8  # of the transmission, by the rule
RESERVE = 0.05
DRAWS = 20
CYCLE = (  # what, s, km/h, kW at the output
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
    """Fuel at a choice [kg/s]; NaN where the tractor cannot hold the demand so."""
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
    """Fuel at a choice, or at the next higher engine speed that holds the demand [kg/s]."""
    rates = (
        fuel(model, engine, (choice[0], speed), output_speed, power)
        for speed in np.arange(choice[1], engine.speed[-1], 2.0).tolist()
    )
    return next((rate for rate in rates if math.isfinite(rate)), math.nan)


def by_rule(
    model: hmcvt.EfficiencyModel,
    engine: hmcvt.Engine,
    output_speed: float,
    power: float,
) -> Choice:
    """Engine speed of least fuel for the power, by the engine alone; the stage of least stroke."""
    speeds = np.linspace(engine.speed[0], engine.speed[-1], 200)
    torque = power / ASSUMED / speeds
    rates = engine.fuel_rate(speeds, torque)
    rates[torque > (1.0 - RESERVE) * engine.full_load_torque(speeds)] = np.nan
    for at in np.argsort(rates):  # NaN comes last
        strokes = {}
        for name, stage in model.stages.items():
            with contextlib.suppress(hmcvt.InputError):
                strokes[name] = abs(
                    operating_point(
                        stage,
                        float(speeds[at]),
                        {"output_speed": output_speed, "output_power": power},
                    )[0]
                )
        feasible = [
            name
            for name in sorted(strokes, key=strokes.__getitem__)
            if math.isfinite(
                fuel(model, engine, (name, float(speeds[at])), output_speed, power)
            )
        ]
        if feasible:
            return feasible[0], float(speeds[at])
    raise SystemExit(f"no stage holds {output_speed:.0f} rad/s at {power / 1e3:.0f} kW")


def drawn(model: hmcvt.EfficiencyModel, seed: int) -> list[hmcvt.EfficiencyModel]:
    """The model with parameters drawn from their covariance, as far as these are possible."""
    known = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    errors, rng = (
        np.array(list(known.standard_errors.values())),
        np.random.default_rng(seed),
    )
    spread = np.linalg.cholesky(known.correlation)
    found: list[hmcvt.EfficiencyModel] = []
    while len(found) < DRAWS:
        values = known.parameters.to_array() + errors * (spread @ rng.normal(size=3))
        if (values > 1e-13).all():
            found.append(
                replace(model, parameters=hmcvt.HydraulicParameters(*values.tolist()))
            )
    return found


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
        told = "   ".join(
            f"{stage:>3} {speed * 30 / math.pi:5.0f} r/min" for stage, speed in choices
        )
        print(
            f"{name:<13} {speed:4.0f} {kilowatts:4.0f}   {told}   "
            + " ".join(f"{1e3 * rate:.2f}" for rate in rates[:, 0])
        )
    saved, *others = (100.0 * (1.0 - used[0] / used[1])).tolist()
    print(
        f"cycle: {used[0][0]:.2f} kg by the optimum, {used[1][0]:.2f} kg by the rule: "
        f"{saved:.1f} % less on the model itself"
    )
    if held := [each for each in others if math.isfinite(each)]:
        low, middle, high = np.quantile(held, (0.05, 0.5, 0.95))
        print(
            f"on {len(held)} of {len(others)} drawn tractors, which can drive it at all: "
            f"{middle:.1f} % less (median), 90 % of them {low:.1f} to {high:.1f} %"
        )


def files() -> tuple[hmcvt.EfficiencyModel, hmcvt.Engine]:
    """Read the shipped tractor and its engine."""
    return (
        hmcvt.load_model(hmcvt.data_path("params/tractor.yaml")),
        hmcvt.load_engine(hmcvt.data_path("params/engine.yaml")),
    )


def main() -> None:
    """Compare, on tractors that may be too."""
    model, engine = files()

    def best(output_speed: float, power: float) -> Choice:
        found = model.optimal_drive(
            output_speed, power, engine=engine, torque_reserve=RESERVE
        )
        return str(found.stage), found.engine_speed

    compare([model, *drawn(model, seed=0)], engine, best)


if __name__ == "__main__":
    main()

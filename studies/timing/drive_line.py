# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The optimum of the drive line beside brute force: stage, engine speed, displacement ratio."""

import math
import time
from collections.abc import Iterator

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS
from studies.page import Goal, spread

from .timing import Section, at_most

STROKES, SPEEDS, DEMANDS = 2001, 400, 500


def brute_force(
    model: hmcvt.EfficiencyModel,
    engine: hmcvt.Engine,
    output_speed: float,
    power: float,
) -> float:
    """Least fuel [kg/s] over every stage, through the public lookup alone; strokes interpolated."""
    speed, stroke = (
        np.linspace(*ENGINE_SPEED_LIMITS, SPEEDS),
        np.linspace(-1.0, 1.0, STROKES),
    )
    best = math.inf
    for stage in model.stages.values():
        off = stage.output_speed(stroke[:, None], speed, power / speed) - output_speed
        at, which = np.nonzero(np.sign(off[:-1]) * np.sign(off[1:]) <= 0.0)
        if not len(at):
            continue
        part = off[at, which] / (off[at, which] - off[at + 1, which])
        needed = stroke[at] + np.nan_to_num(part) * (stroke[1] - stroke[0])
        load = power / speed[which]
        fuel = engine.fuel_rate(
            speed[which], load / stage.efficiency(needed, speed[which], load)
        )
        best = min(best, np.nan_to_num(fuel, nan=math.inf).min(initial=math.inf))
    return best


def demands(count: int, seed: int) -> Iterator[tuple[float, float]]:
    """Draw output speeds [rad/s] and powers [W]."""
    rng = np.random.default_rng(seed)
    return zip(
        rng.uniform(8.0, 330.0, count).tolist(),
        rng.uniform(5e3, 120e3, count).tolist(),
        strict=True,
    )


def section(count: int = DEMANDS, seed: int = 7) -> Section:
    """Compare and time every demand."""
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    above, beyond, missed, times = [], 0, 0, []
    for demand in demands(count, seed):
        turns = []
        for _ in range(3):
            begun = time.process_time()
            found = model.optimal_drive(*demand, engine=engine)
            turns.append(time.process_time() - begun)
        times.append(1e3 * min(turns))
        brute = brute_force(model, engine, *demand)
        if found.stage is None:
            missed += math.isfinite(brute)
            continue
        above.append(found.fuel_rate / brute - 1.0)
        beyond += not found.engine_torque <= (1.0 + 1e-9) * engine.full_load_torque(
            found.engine_speed
        )
    worst = max(above)
    return Section(
        [
            Goal(
                f"drive line: fuel above brute force ({STROKES} strokes, {SPEEDS} engine speeds, "
                f"{len(model.stages)} stages), at most, of {len(above)} demands that can be held",
                "at most 0.1 %",
                f"{100.0 * worst:.2g} %",
                worst <= 1e-3,
            ),
            Goal(
                f"drive line: of {count} demands, missed or beyond the full-load curve",
                "none",
                f"{missed} and {beyond}",
                not missed and not beyond,
            ),
            at_most("drive line: one demand", spread(times), 3.0, " ms"),
            Goal(
                "drive line: the slowest demand",
                "at most 3 ms",
                f"{max(times):.2g} ms",
                max(times) <= 3.0,
            ),
        ],
        {},
    )

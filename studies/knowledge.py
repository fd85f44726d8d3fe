# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How much fuel does a strategy lose whose model comes from few tests, or misses an effect?

    python -m studies.knowledge [TRACTORS]

Tractors are drawn around the shipped one: their leakage and dampings spread by 30 %. Each is tested
at random points of stage HM4 with the uncertainty of the paper's bench (1.12 %); its model is
identified from 5, 8, 24 and 96 of the tests. The causal strategy then drives parts of two cycles
with that model. One more tractor of each draw has an effect that its model, identified from 96
tests, misses. Prints medians and the range of 90 % of the tractors.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.base import Effect
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.physics.effects.mechanical import ChargePump, Churning
from hmcvt_core.transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY
from hmcvt_tools.mission import Cycle, Drive, load_vehicle, read_cycle
from hmcvt_tools.mission.knowledge import in_transmission, worth

TESTS = (5, 8, 24, 96)
CYCLES = ("ploughing", "transport")
SECONDS = 400
SPREAD = 0.3
EFFECTS: tuple[Effect, ...] = (
    ChargePump(4.0),
    Churning(6.0, 1.5),
    PressureLeakage(1.5e-11, 1.0),
)


def shortened(cycle: Cycle) -> Cycle:
    """Return the first `SECONDS` of a cycle."""
    arrays: dict[str, Any] = {}
    for item in fields(cycle):
        value = getattr(cycle, item.name)
        if isinstance(value, np.ndarray):
            arrays[item.name] = value[:SECONDS]
    ground = {name: watts[:SECONDS] for name, watts in cycle.ground.items()}
    return replace(cycle, **arrays, ground=ground)


def drawn(
    model: hmcvt.EfficiencyModel, rng: np.random.Generator
) -> hmcvt.EfficiencyModel:
    """Return a tractor near a model."""
    factors = np.exp(SPREAD * rng.normal(size=3))
    values = model.parameters.to_array() * factors
    return replace(model, parameters=hmcvt.HydraulicParameters(*values.tolist()))


def bench(
    tractor: hmcvt.EfficiencyModel, count: int, rng: np.random.Generator
) -> hmcvt.BenchSamples:
    """Return tests of stage HM4 at random points, with the noise of the paper's bench."""
    stage = tractor.stages["HM4"]
    points = np.empty((0, 4))
    while len(points) < count:
        stroke = rng.uniform(-0.95, 0.95, 2 * count)
        speed = rng.uniform(90.0, 230.0, 2 * count)
        load = rng.uniform(40.0, 450.0, 2 * count)
        efficiency = stage.efficiency(stroke, speed, load)
        columns = np.column_stack([stroke, speed, load, efficiency])
        points = np.vstack([points, columns[efficiency > 0.3]])
    stroke, speed, load, efficiency = points[:count].T
    noise = PAPER_EFFICIENCY_UNCERTAINTY * efficiency * rng.normal(size=count)
    return hmcvt.BenchSamples(stroke, speed, load, np.minimum(efficiency + noise, 0.99))


def losses(
    truth: Drive, believed: hmcvt.EfficiencyModel, cycles: Sequence[Cycle]
) -> Iterator[float]:
    """Yield the fuel lost on each cycle with a model that differs from the tractor [%]."""
    for cycle in cycles:
        yield 100.0 * worth(truth, believed, cycle).lost_part


def identified(
    samples: hmcvt.BenchSamples, tractor: hmcvt.EfficiencyModel
) -> hmcvt.EfficiencyModel:
    """Return the tractor as tests of HM4 show it."""
    fit = hmcvt.identify(samples, stage=tractor.stages["HM4"].stage)
    return in_transmission(fit.model, replace(tractor, effects=()))


def table_line(name: str, values: Sequence[float]) -> str:
    """Return median and range of values as text."""
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    return f"{name:<34} {middle:6.3f} % ({low:.3f} to {high:.3f})"


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    vehicle = load_vehicle(hmcvt.data_path("params/vehicle.yaml"))
    cycles = [shortened(read_cycle(name, vehicle)) for name in CYCLES]
    lost: dict[str, list[float]] = {}
    for seed in range(count):
        rng = np.random.default_rng(seed)
        tractor = drawn(model, rng)
        truth = Drive(tractor, engine, vehicle)
        samples = bench(tractor, max(TESTS), rng)
        for tests in TESTS:
            believed = identified(samples.select(np.arange(tests)), tractor)
            for cycle, part in zip(
                CYCLES, losses(truth, believed, cycles), strict=True
            ):
                lost.setdefault(f"{cycle}, {tests} tests", []).append(part)
        effect = EFFECTS[seed % len(EFFECTS)]
        changed = replace(tractor, effects=(effect,))
        believed = identified(bench(changed, max(TESTS), rng), tractor)
        missing = losses(truth._replace(model=changed), believed, cycles)
        for cycle, part in zip(CYCLES, missing, strict=True):
            lost.setdefault(f"{cycle}, an effect missing", []).append(part)
        print(f"tractor {seed + 1} of {count}", file=sys.stderr)
    print(f"fuel lost, median and 90 % of {count} tractors")
    for name in sorted(lost):
        print(table_line(name, lost[name]))


if __name__ == "__main__":
    main()

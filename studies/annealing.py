# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How near the annealing comes by itself: `python -m studies.annealing [--seeds N] [--twins N]`.

The improved annealing as `identify` runs it, before any local search; the same in one round, as the
paper prints it; the standard one; a genetic algorithm (pymoo, extra `compare`) and differential
evolution (SciPy). All have the same budget of evaluations, within the same bounds, on the
objective of `power_balance`. "Within" is of the lowest objective, that of least squares from many
points.

The twins are random transmissions with random samples: stages of the shipped files, parameters over
the range of `SEARCH_BOUNDS`, 5 to 100 samples, noise of 0.1 to 1.1 %, stated or not.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import hmcvt_core as hmcvt
from hmcvt_core.identification.annealing import Schedule, minimise
from hmcvt_core.identification.identify import SCHEDULES
from hmcvt_core.identification.problem import Problem
from hmcvt_core.transmission.parameters import (
    PAPER_PARAMETERS,
    SEARCH_BOUNDS,
    from_scaled,
)

Array = NDArray[np.float64]
Search = Callable[[Problem, int], float]
"""Takes a problem and a seed; gives the lowest objective that it reached."""

BUDGET = 13_000
"""Evaluations of each algorithm."""
_PARTICLES = 50
_STARTS = 16  # of the least squares that give the lowest objective
_NO_ANSWER = 1e6


def _never(steps: int, slow_steps: Array) -> Array:
    """The standard algorithm's disturbance: the same range from first to last."""
    return np.zeros_like(slow_steps)


SERVED = SCHEDULES["power_balance"]
ONE_ROUND = Schedule(chains=40, moves=6)
STANDARD = Schedule(chains=25, moves=4, shrink=_never, cooling=(0.9, 0.9))


def _annealing(schedule: Schedule) -> Search:
    def search(problem: Problem, seed: int) -> float:
        return minimise(
            problem.objective, SEARCH_BOUNDS, schedule=schedule, seed=seed
        ).value

    return search


def _genetic(problem: Problem, seed: int) -> float:
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import Problem as Minimisation
    from pymoo.optimize import minimize

    class Scaled(Minimisation):  # type: ignore[misc]
        def __init__(self) -> None:
            low, high = SEARCH_BOUNDS.T
            super().__init__(n_var=len(low), n_obj=1, xl=low, xu=high)

        def _evaluate(self, points: Array, out: dict[str, Array]) -> None:
            out["F"] = _finite(problem, points)[:, None]

    result = minimize(
        Scaled(), GA(pop_size=_PARTICLES), ("n_eval", BUDGET), seed=seed, verbose=False
    )
    return float(result.F[0])


def _differential_evolution(problem: Problem, seed: int) -> float:
    from scipy.optimize import differential_evolution

    population = 15 * len(SEARCH_BOUNDS)
    result = differential_evolution(
        lambda columns: _finite(problem, columns.T),
        SEARCH_BOUNDS,
        maxiter=BUDGET // population - 1,
        seed=seed,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    return float(result.fun)


def _finite(problem: Problem, points: Array) -> Array:
    return np.nan_to_num(problem.objective(points), nan=_NO_ANSWER)


ALGORITHMS: dict[str, Search] = {
    "improved SA, as served": _annealing(SERVED),
    "improved SA, one round": _annealing(ONE_ROUND),
    "standard SA": _annealing(STANDARD),
    "GA": _genetic,
    "differential evolution": _differential_evolution,
}


@dataclass(frozen=True)
class Row:
    """Runs of one algorithm on one set.

    Attributes:
        problems: name of the set.
        algorithm: what ran.
        excess: value by the lowest, less 1, of every run, shape (n,).
    """

    problems: str
    algorithm: str
    excess: Array

    def __str__(self) -> str:
        count = len(self.excess)
        near = int((self.excess < 1e-2).sum())
        nearer = int((self.excess < 1e-4).sum())
        return (
            f"| {self.problems} | {self.algorithm} | {near} of {count} | "
            f"{nearer} of {count} | {100 * self.excess.max():.2g} % |"
        )


def lowest(problem: Problem) -> float:
    """Lowest objective, by least squares from many points."""
    low, high = SEARCH_BOUNDS.T
    starts = np.random.default_rng(0).uniform(low, high, (_STARTS, len(low)))
    return problem.finish(starts)[1]


def benches() -> dict[str, Problem]:
    """The sets of samples that ship."""
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    model = hmcvt.EfficiencyModel(stage, PAPER_PARAMETERS[0.98])
    table2 = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    simulated = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    return {
        "tests 1, 2, 4, 5, 6 of Table 2": Problem(
            model, table2.select([0, 1, 3, 4, 5])
        ),
        "all eight": Problem(model, table2),
        "96 of `data/simulated.csv`": Problem(model, simulated),
    }


def twin(seed: int) -> Problem:
    """A random transmission and random samples of it."""
    rng = np.random.default_rng(1000 + seed)
    tractor = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    stages = [model.stage for model in tractor.stages.values()]
    stage = stages[int(rng.integers(len(stages)))]
    while True:
        scaled = rng.uniform((-11.5, 0.01, 0.02), (-10.3, 0.4, 0.6))
        parameters = hmcvt.HydraulicParameters(*from_scaled(scaled).tolist())
        model = hmcvt.EfficiencyModel(stage, parameters)
        count = int(rng.choice([5, 8, 12, 20, 40, 100]))
        noise = float(rng.choice([0.001, 0.004, 0.011]))
        stated = rng.random() < 0.5
        point = (
            rng.uniform(-1.0, 1.0, count),
            rng.uniform(80.0, 220.0, count),
            rng.uniform(80.0, 350.0, count),
        )
        measured = model.efficiency(*point) * (1.0 + noise * rng.standard_normal(count))
        # NaN, where the load is not carried, is outside as well.
        if not ((measured > 0.02) & (measured < 1.0)).all():
            continue
        deviation = np.full(count, noise) if stated else None
        return Problem(
            model, hmcvt.BenchSamples(*point, measured, efficiency_std=deviation)
        )


def rows(seeds: int, twins: int) -> Iterator[Row]:
    """Run every algorithm on every set.

    Args:
        seeds: runs on each bench.
        twins: random twins, six runs on each.
    """
    problems = [twin(seed) for seed in range(twins)]
    bests = [lowest(problem) for problem in problems]
    for algorithm, search in ALGORITHMS.items():
        excess = []
        for problem, best in zip(problems, bests, strict=True):
            excess += [search(problem, seed) / best - 1.0 for seed in range(6)]
        yield Row(f"{twins} random twins", algorithm, np.array(excess))
    for name, problem in benches().items():
        best = lowest(problem)
        for algorithm, search in ALGORITHMS.items():
            values = [search(problem, seed) for seed in range(seeds)]
            yield Row(name, algorithm, np.array(values) / best - 1.0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="runs on each bench")
    parser.add_argument("--twins", type=int, default=25, help="random twins")
    options = parser.parse_args()
    print("| samples | algorithm | within 1 % | within 0.01 % | farthest |")
    print("|---|---|---|---|---|", flush=True)
    for row in rows(options.seeds, options.twins):
        print(row, flush=True)


if __name__ == "__main__":
    main()

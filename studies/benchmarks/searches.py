# SPDX-License-Identifier: Apache-2.0
"""Ways to identify the parameters: ours, ours in parts, and those of three libraries.

All minimise the same function, `Problem.objective`, within the same bounds. It takes one
candidate or many at once, and each search gets it in the way it can use best. Settings are the
libraries' own unless said otherwise; nobody is told the value to reach.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

import hmcvt_core as hmcvt
from hmcvt_core.identification import annealing
from hmcvt_core.identification.problem import Problem
from hmcvt_core.transmission.parameters import PAPER_PARAMETERS
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS as BOUNDS

Array = NDArray[np.float64]

NO_ANSWER = 1e9  # objective where the model has none
_FAR = 1e3  # residual there
_STEP = 1e-7
_MODULE = importlib.import_module("hmcvt_core.identification.identify")


class Recorder:
    """Counts evaluations, and notes when a value was first reached.

    Attributes:
        evaluations: candidates evaluated so far.
        lowest: lowest value so far.
        reached: evaluations and clock when the target was first met; None before.
    """

    def __init__(self, target: float, clock: Callable[[], float]) -> None:
        self.target, self.clock = target, clock
        self.evaluations, self.lowest = 0, math.inf
        self.reached: tuple[int, float] | None = None

    def note(self, values: Array) -> None:
        """Take the values of one or more candidates."""
        self.evaluations += values.size
        low = float(values) if values.ndim == 0 else float(np.fmin.reduce(values.ravel()))
        if low < self.lowest:
            self.lowest = low
            if self.reached is None and low <= self.target:
                self.reached = self.evaluations, self.clock()

    def problem(self) -> type[Problem]:
        """Return the kind of problem that notes here whatever is evaluated."""
        note = self.note

        class Recorded(Problem):
            def residuals(self, scaled: Array) -> Array:
                found = super().residuals(scaled)
                note(np.mean(found**2, axis=-1))
                return found

            def objective(self, scaled: Array) -> Array:
                found = np.asarray(np.mean(super().residuals(scaled) ** 2, axis=-1))
                note(found)
                return found

        return Recorded


@dataclass(frozen=True)
class Search:
    """One way.

    Attributes:
        name: as the document calls it.
        kind: `ours`, `part` of ours, `global` or `local`.
        run: takes the kind of problem, samples and a seed.
        seeds: how many it is given.
    """

    name: str
    kind: str
    run: Callable[[type[Problem], hmcvt.BenchSamples, int], Any]
    seeds: int = 100


@cache
def base() -> hmcvt.EfficiencyModel:
    """Return the form of model that is identified."""
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    return hmcvt.EfficiencyModel(stage, PAPER_PARAMETERS[0.98])


def lowest_known(samples: hmcvt.BenchSamples) -> float:
    """Return the lowest value that least squares finds from many points."""
    points = BOUNDS[:, 0] + np.diff(BOUNDS)[:, 0] * np.random.default_rng(0).random((64, 3))
    return Problem(base(), samples).finish(points)[1]


# --- ours -----------------------------------------------------------------------------------------


def _identify(schedule: annealing.Schedule | None, kind: type[Problem],
              samples: hmcvt.BenchSamples, seed: int) -> None:
    with mock.patch.object(_MODULE, "Problem", kind):
        hmcvt.identify(samples, schedule=schedule, seed=seed)


def _anneal(schedule: annealing.Schedule, kind: type[Problem], samples: hmcvt.BenchSamples,
            seed: int) -> None:
    annealing.minimise(kind(base(), samples).objective, BOUNDS, schedule=schedule,
                       seed=seed)


# --- SciPy ----------------------------------------------------------------------------------------


def _one_at_a_time(problem: Problem) -> Callable[[Array], float]:
    def value(scaled: Array) -> float:
        found = float(problem.objective(scaled))
        return NO_ANSWER if math.isnan(found) else found

    return value


def _many_at_once(problem: Problem) -> Callable[[Array], Array]:
    return lambda scaled: np.nan_to_num(problem.objective(scaled), nan=NO_ANSWER)


def _dual_annealing(kind: type[Problem], samples: hmcvt.BenchSamples, seed: int) -> None:
    optimize.dual_annealing(_one_at_a_time(kind(base(), samples)), BOUNDS, rng=seed)


def _evolution(kind: type[Problem], samples: hmcvt.BenchSamples, seed: int) -> None:
    optimize.differential_evolution(_one_at_a_time(kind(base(), samples)), BOUNDS, rng=seed)


def _vectorised_evolution(kind: type[Problem], samples: hmcvt.BenchSamples, seed: int) -> None:
    value = _many_at_once(kind(base(), samples))
    optimize.differential_evolution(lambda columns: value(columns.T), BOUNDS, rng=seed,
                                    vectorized=True, updating="deferred")


def _least_squares(starts: int, kind: type[Problem], samples: hmcvt.BenchSamples,
                   seed: int) -> None:
    problem = kind(base(), samples)

    def residuals(scaled: Array) -> Array:
        return np.nan_to_num(problem.residuals(scaled), nan=_FAR)

    def slopes(scaled: Array) -> Array:
        """Differences, all at once."""
        steps = np.where(scaled + _STEP <= BOUNDS[:, 1], _STEP, -_STEP)
        found = residuals(np.vstack([scaled, scaled + np.diag(steps)]))
        return ((found[1:] - found[0]) / steps[:, None]).T

    rng = np.random.default_rng(seed)
    for _ in range(starts):
        optimize.least_squares(residuals, rng.uniform(*BOUNDS.T), jac=slopes, bounds=BOUNDS.T)


# --- pymoo and cma --------------------------------------------------------------------------------


def _pymoo(name: str, kind: type[Problem], samples: hmcvt.BenchSamples, seed: int) -> None:
    from pymoo.algorithms.soo.nonconvex import ga, pso
    from pymoo.core.problem import Problem as Minimisation
    from pymoo.optimize import minimize

    value = _many_at_once(kind(base(), samples))

    class Identification(Minimisation):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=len(BOUNDS), n_obj=1, xl=BOUNDS[:, 0], xu=BOUNDS[:, 1])

        def _evaluate(self, x: Array, out: dict[str, Array], *_: object, **__: object) -> None:
            out["F"] = value(x)[:, None]

    minimize(Identification(), {"GA": ga.GA, "PSO": pso.PSO}[name](), seed=seed)


def _cma(kind: type[Problem], samples: hmcvt.BenchSamples, seed: int) -> None:
    import cma

    value, rng = _many_at_once(kind(base(), samples)), np.random.default_rng(seed)
    # Its step is one for all variables: they are scaled to 0 to 1.
    width = np.diff(BOUNDS)[:, 0]
    strategy = cma.CMAEvolutionStrategy(rng.random(3), 0.3, {
        "bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9})
    while not strategy.stop():
        candidates = strategy.ask()
        strategy.tell(candidates, value(BOUNDS[:, 0] + width * np.array(candidates)).tolist())


OURS, PAPER = "`hmcvt.identify`", "the paper's schedule"
SINGLE_START = "SciPy `least_squares`, 1 random start"
CHAINS = _MODULE.SIDE_BY_SIDE
SEARCHES = (
    Search(OURS, "ours", partial(_identify, None)),
    Search(PAPER, "part", partial(_anneal, annealing.IMPROVED), 50),
    Search(f"{CHAINS.chains} chains of {CHAINS.moves} move a step, evaluated at once", "part",
           partial(_anneal, CHAINS), 50),
    Search("the paper's schedule and the least-squares finish", "part",
           partial(_identify, annealing.IMPROVED), 50),
    Search("SciPy `dual_annealing`", "global", _dual_annealing, 20),
    Search("SciPy `differential_evolution`", "global", _evolution, 50),
    Search("SciPy `differential_evolution`, vectorised", "global", _vectorised_evolution),
    Search("pymoo GA", "global", partial(_pymoo, "GA"), 15),
    Search("pymoo PSO", "global", partial(_pymoo, "PSO")),
    Search("cma CMA-ES", "global", _cma),
    Search(SINGLE_START, "local", partial(_least_squares, 1)),
    Search("SciPy `least_squares`, 8 random starts", "local", partial(_least_squares, 8)),
)

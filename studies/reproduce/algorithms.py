# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The algorithms of figure 6 on the paper's identification: improved and standard SA, GA, PSO.

All minimise 1 - RSQ (21) over the same three scaled parameters within the same bounds, gear
efficiency 0.98, tests 1, 2, 4, 5 and 6. Each temperature step of the annealing holds as many trial
points as a generation of the others. GA and PSO are pymoo's (extra `compare`): the GA
with its own settings, the PSO with constriction coefficients (Clerc and Kennedy, 2002).

The four improvements of section 4.1 are the threshold, the disturbance and the cooling of
`annealing.Schedule`, and the start that part 1 gives: each can be left out alone.
"""

import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.soo.nonconvex import ga, pso
from pymoo.core.problem import Problem as Minimisation
from pymoo.optimize import minimize

from hmcvt_core.identification import identify
from hmcvt_core.identification.annealing import Schedule, minimise, with_steps
from hmcvt_core.identification.piecewise import hydraulic_roots, starting_points
from hmcvt_core.identification.problem import Problem
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS as BOUNDS

from . import paper
from .bench import FITTED, problem, stage, table2

Array = NDArray[np.float64]

IMPROVED_SA, STANDARD_SA, COOLER, SERVED = (
    "improved SA",
    "standard SA",
    "improved SA, cooler",
    "hmcvt identify",
)
GA, PSO = "GA", "PSO"
WITHOUT = {
    1: "without (1) threshold",
    2: "without (2) shrinking disturbance",
    3: "without (3) adaptive cooling",
    4: "without (4) two-part start",
}
ANNEALING = (IMPROVED_SA, *WITHOUT.values(), STANDARD_SA, COOLER)

NEAR = 1.05
"""An end counts as the global optimum within this factor; also the threshold of improvement (1)."""

_COOLER = (1e-2, 1e-8)  # t_0, t_end
_CONSTRICTION = {"w": 0.7298, "c1": 1.49618, "c2": 1.49618}
_PENALTY = 1e6  # stands for "no answer"; the others cannot handle infinity


@dataclass(frozen=True)
class Run:
    """One run of one algorithm.

    Attributes:
        algorithm, seed: what ran.
        value: lowest 1 - RSQ; infinite where no point had an answer.
        evaluations: points at which the model was asked (part 1 not counted).
        seconds: processor time, part 1 included.
        curve: (evaluations, lowest so far) after each batch of points that improved it.
    """

    algorithm: str
    seed: int
    value: float
    evaluations: int
    seconds: float
    curve: tuple[tuple[int, float], ...]

    def evaluations_to(self, target: float) -> int:
        """Evaluations until the value was at most a target; all of them where it never was."""
        return next(
            (count for count, value in self.curve if value <= target), self.evaluations
        )


def never(steps: int, slow_steps: Array) -> Array:
    """The standard algorithm's disturbance: the same range from first to last."""
    return np.zeros_like(slow_steps)


STANDARD = Schedule(shrink=never, cooling=(0.9, 0.9), moves=paper.PARTICLES)


@dataclass(frozen=True)
class Task:
    """What a worker runs; `lowest` is the lowest 1 - RSQ known."""

    algorithm: str
    seed: int
    lowest: float


@dataclass
class _Recorder:
    """The objective, keeping count and the curve."""

    objective: Callable[[Array], Array]
    evaluations: int = 0
    curve: list[tuple[int, float]] = field(default_factory=list)

    def __call__(self, points: Array) -> Array:
        values = self.objective(points)
        self.evaluations += len(points)
        best = float(np.min(np.nan_to_num(values, nan=np.inf)))
        if np.isfinite(best) and (not self.curve or best < self.curve[-1][1]):
            self.curve.append((self.evaluations, best))
        return values


def run(task: Task) -> Run:
    """Run one algorithm once."""
    if task.algorithm == SERVED:
        return _served(task)
    recorder = _Recorder(_problem().objective)
    if task.algorithm in ANNEALING:
        schedule, two_part = _settings(task.algorithm, NEAR * task.lowest)
        start, spent = _part_one() if two_part else (None, 0.0)
        begun = time.process_time()
        minimise(recorder, BOUNDS, schedule=schedule, seed=task.seed, start=start)
    else:
        spent = 0.0
        search = _population(task.algorithm)
        begun = time.process_time()
        search(recorder, task.seed)
    spent += time.process_time() - begun
    # A start that has no answer may never find one.
    value = recorder.curve[-1][1] if recorder.curve else math.inf
    return Run(
        task.algorithm,
        task.seed,
        value,
        recorder.evaluations,
        spent,
        tuple(recorder.curve),
    )


def _settings(algorithm: str, threshold: float) -> tuple[Schedule, bool]:
    """Schedule, and whether it starts from part 1."""
    improved = Schedule(shrink=with_steps, moves=paper.PARTICLES, threshold=threshold)
    return {
        IMPROVED_SA: (improved, True),
        WITHOUT[1]: (replace(improved, threshold=None), True),
        WITHOUT[2]: (replace(improved, shrink=never), True),
        WITHOUT[3]: (replace(improved, cooling=STANDARD.cooling), True),
        WITHOUT[4]: (improved, False),
        STANDARD_SA: (STANDARD, False),
        COOLER: (
            replace(
                improved, initial_temperature=_COOLER[0], final_temperature=_COOLER[1]
            ),
            True,
        ),
    }[algorithm]


@functools.cache
def _problem() -> Problem:
    return Problem(problem("published").model, table2().select(FITTED))


@functools.cache
def _part_one() -> tuple[Array, float]:
    """Start of part 2, shape (3,), and the processor time that part 1 takes (best of two)."""
    times = []
    for _ in range(2):
        begun = time.process_time()
        starts = starting_points(
            _problem(), hydraulic_roots(stage(), _problem().samples)
        )
        times.append(time.process_time() - begun)
    values = _problem().objective(starts)
    return starts[int(np.nanargmin(values))], min(times)


def _served(task: Task) -> Run:
    begun = time.process_time()
    found = identify(
        _problem().samples, stage=stage(), formulation="published", seed=task.seed
    )
    spent = time.process_time() - begun
    return Run(
        SERVED,
        task.seed,
        found.objective,
        found.evaluations,
        spent,
        ((found.evaluations, found.objective),),
    )


def _population(name: str) -> Callable[[_Recorder, int], None]:
    """GA or PSO, ready to run."""

    class Identification(Minimisation):  # type: ignore[misc]
        """The recorder as pymoo wants it."""

        def __init__(self, recorder: _Recorder) -> None:
            super().__init__(
                n_var=len(BOUNDS), n_obj=1, xl=BOUNDS[:, 0], xu=BOUNDS[:, 1]
            )
            self.recorder = recorder

        def _evaluate(
            self, x: Array, out: dict[str, Array], *_: object, **__: object
        ) -> None:
            out["F"] = np.nan_to_num(self.recorder(x), nan=_PENALTY, posinf=_PENALTY)[
                :, None
            ]

    def search(recorder: _Recorder, seed: int) -> None:
        algorithm = (
            ga.GA(pop_size=paper.PARTICLES)
            if name == GA
            else pso.PSO(
                pop_size=paper.PARTICLES,
                adaptive=False,
                pertube_best=False,
                **_CONSTRICTION,
            )
        )
        minimize(
            Identification(recorder), algorithm, ("n_gen", paper.ITERATIONS), seed=seed
        )

    return search

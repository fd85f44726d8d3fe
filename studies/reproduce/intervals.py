# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How well five tests determine three parameters: intervals and correlations.

A parameter is held at a value while the others are fitted; the interval holds the values at which
the sum of squares stays below S_min (1 + F / (n - 3)), F the 95 % point of the F distribution with
1 and n - 3 degrees of freedom: the scatter is judged from the residuals, and the model need not be
linear in the parameters.
"""

import functools

from scipy.optimize import brentq
from scipy.stats import f as f_distribution

from hmcvt_core.identification import Identification, identify
from hmcvt_core.identification.problem import Problem
from hmcvt_core.transmission.parameters import (
    PARAMETER_NAMES,
    PARAMETER_UNITS,
    to_scaled,
)
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS as BOUNDS

from .bench import FITTED, lowest, problem, stage, table2
from .item import DIFFERS, NOT_REPRODUCIBLE, REPRODUCED, Item

GROUP = "Three parameters from five tests"
FORMULATION = "power_balance"
SETS = {"five tests": tuple(FITTED.tolist()), "eight tests": tuple(range(8))}
_LOOSE = 0.5  # half width / value beyond which a parameter counts as undetermined


@functools.cache
def _problem(tests: str) -> Problem:
    return Problem(problem(FORMULATION).model, table2().select(list(SETS[tests])))


@functools.cache
def _fitted(tests: str) -> Identification:
    return identify(_problem(tests).samples, stage=stage(), formulation=FORMULATION)


TASKS = [(tests, i) for tests in SETS for i in range(len(BOUNDS))]


def interval(task: tuple[str, int]) -> Item:
    """Find the ends of an interval: the limit of the squares, or the bound of the search."""
    tests, i = task
    fitted, objective, name = (
        _fitted(tests),
        _problem(tests).objective,
        PARAMETER_NAMES[i],
    )
    free = len(SETS[tests]) - len(BOUNDS)
    limit = fitted.objective * (1.0 + float(f_distribution.ppf(0.95, 1, free)) / free)

    def excess(held: float) -> float:
        box = BOUNDS.copy()
        box[i] = held
        return float(objective(lowest(objective, box))) - limit

    best = to_scaled(fitted.parameters.to_array())[i]
    open_ = [excess(bound) <= 0.0 for bound in BOUNDS[i]]
    ends = [
        bound if at_bound else brentq(excess, best, bound, xtol=1e-4)
        for bound, at_bound in zip(BOUNDS[i], open_, strict=True)
    ]
    best, low, high = (10.0**end if name == "leakage" else end for end in (best, *ends))
    determined = (high - low) / 2.0 <= _LOOSE * best and not open_[1]
    words = [
        f"{end:.2g}{' (bound)' * at_bound}"
        for end, at_bound in zip((low, high), open_, strict=True)
    ]
    return Item(
        GROUP,
        f"{name} from {tests} [{PARAMETER_UNITS[name]}]",
        "three digits",
        f"{best:.3g}, 95 %: {' to '.join(words)}",
        REPRODUCED if determined else DIFFERS,
        ""
        if determined
        else "not determined: half the interval exceeds "
        f"{100 * _LOOSE:.0f} % of the value, or it ends at a bound",
    )


def tie(tests: str) -> Item:
    """Linearised correlation of the parameters."""
    matrix = _fitted(tests).correlation
    pairs = [(0, 1), (0, 2), (1, 2)]
    words = ", ".join(
        f"{PARAMETER_NAMES[i]} and {PARAMETER_NAMES[j]} {matrix[i, j]:+.2f}"
        for i, j in pairs
    )
    return Item(
        GROUP,
        f"correlations, {tests}",
        None,
        words,
        NOT_REPRODUCIBLE,
        "the paper states none",
    )

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How well five tests determine three parameters: profiles and correlations.

A parameter is held at a value while the others are fitted; the interval holds the values at which
the sum of squares stays below S_min (1 + F / (n - 3)), F the 95 % point of the F distribution with
1 and n - 3 degrees of freedom: the scatter is judged from the residuals, and the model need not be
linear in the parameters.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import f as f_distribution

from hmcvt_core.identification import Identification, identify
from hmcvt_core.identification.problem import Problem
from hmcvt_core.transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS as BOUNDS

from .bench import FITTED, problem, stage, table2
from .item import DIFFERS, NOT_REPRODUCIBLE, REPRODUCED, Item

Array = NDArray[np.float64]
GROUP = "Three parameters from five tests"
FORMULATION = "power_balance"
SETS = {"five tests": tuple(FITTED.tolist()), "eight tests": tuple(range(8))}
_STEPS = 81
_GRID = 17  # first guesses per free parameter
_LOOSE = 0.5  # half width / value beyond which a parameter counts as undetermined


@dataclass(frozen=True, eq=False)
class Profile:
    """Profile of one parameter.

    Attributes:
        parameter: its name.
        tests: a key of `SETS`.
        values: parameter held, shape (m,), in its unit.
        squares: lowest sum of squared weighted residuals there, shape (m,).
        limit: the sum that bounds the interval.
        best: value fitted.
    """

    parameter: str
    tests: str
    values: Array
    squares: Array
    limit: float
    best: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval; ends at the bound of the search where the profile does."""
        inside = np.flatnonzero(self.squares <= self.limit)
        return self._end(inside[0], -1), self._end(inside[-1], 1)

    @property
    def determined(self) -> bool:
        """Whether the interval is narrow against the value and ends within the bounds."""
        low, high = self.interval
        return (high - low) / 2.0 <= _LOOSE * self.best and high < self.values[-1]

    def _end(self, i: int, step: int) -> float:
        if not 0 <= i + step < len(self.values):
            return float(self.values[i])
        a, b = self.squares[i], self.squares[i + step]
        part = (self.limit - a) / (b - a)
        return float(self.values[i] + part * (self.values[i + step] - self.values[i]))


@functools.cache
def _problem(tests: str) -> Problem:
    return Problem(problem(FORMULATION).model, table2().select(list(SETS[tests])))


@functools.cache
def _fitted(tests: str) -> Identification:
    return identify(_problem(tests).samples, stage=stage(), formulation=FORMULATION)


def tasks() -> list[tuple[str, int, int]]:
    """Set of tests, parameter and step of every point of every profile."""
    return [(tests, i, k) for tests in SETS for i in range(len(BOUNDS)) for k in range(_STEPS)]


def profile_point(task: tuple[str, int, int]) -> float:
    """Lowest sum of squares with one parameter held."""
    tests, i, k = task
    found, held = _problem(tests), _held(i)[k]
    free = [j for j in range(len(BOUNDS)) if j != i]

    def full(others: Array) -> Array:
        return np.insert(others, i, held, axis=-1)

    axes = [np.linspace(BOUNDS[j, 0], BOUNDS[j, 1], _GRID) for j in free]
    guesses = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, len(free))
    squares = np.sum(found.residuals(full(guesses)) ** 2, axis=-1)
    ends = [least_squares(lambda others: found.residuals(full(others)), guesses[start],
                          bounds=BOUNDS[free].T) for start in np.argsort(squares)[:2]]
    return float(2.0 * min(end.cost for end in ends))


def _held(i: int) -> Array:
    return np.linspace(BOUNDS[i, 0], BOUNDS[i, 1], _STEPS)


def profiles(squares: list[float]) -> list[Profile]:
    """Sort the results of `tasks` into profiles."""
    found = []
    rows = np.array(squares).reshape(-1, _STEPS)
    keys = [(tests, i) for tests in SETS for i in range(len(BOUNDS))]
    for (tests, i), row in zip(keys, rows, strict=True):
        fitted = _fitted(tests)
        best = getattr(fitted.parameters, PARAMETER_NAMES[i])
        least, free = fitted.objective * len(SETS[tests]), len(SETS[tests]) - len(BOUNDS)
        limit = least * (1.0 + float(f_distribution.ppf(0.95, 1, free)) / free)
        values = 10.0 ** _held(i) if PARAMETER_NAMES[i] == "leakage" else _held(i)
        found.append(Profile(PARAMETER_NAMES[i], tests, values, row, limit, best))
    return found


def items(found: list[Profile]) -> list[Item]:
    """Interval of each parameter, and the ties between them."""
    return [*(_item(profile) for profile in found), *(_tie(tests) for tests in SETS)]


def _item(profile: Profile) -> Item:
    low, high = profile.interval
    unit = PARAMETER_UNITS[profile.parameter]
    ends = [" (bound)" if value == end else "" for value, end in
            ((low, profile.values[0]), (high, profile.values[-1]))]
    return Item(
        GROUP, f"{profile.parameter} from {profile.tests} [{unit}]", "three digits",
        f"{profile.best:.3g}, 95 %: {low:.2g}{ends[0]} to {high:.2g}{ends[1]}",
        REPRODUCED if profile.determined else DIFFERS,
        "" if profile.determined else "not determined: half the interval exceeds "
        f"{100 * _LOOSE:.0f} % of the value, or it ends at a bound")


def _tie(tests: str) -> Item:
    """Linearised correlation of the parameters."""
    matrix = _fitted(tests).correlation
    pairs = [(0, 1), (0, 2), (1, 2)]
    words = ", ".join(f"{PARAMETER_NAMES[i]} and {PARAMETER_NAMES[j]} {matrix[i, j]:+.2f}"
                      for i, j in pairs)
    return Item(GROUP, f"correlations, {tests}", None, words, NOT_REPRODUCIBLE,
                "the paper states none")

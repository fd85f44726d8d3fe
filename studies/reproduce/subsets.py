# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Are five tests enough? Every subset of Table 2 with at least three, fitted and predicted."""

import itertools
from dataclasses import dataclass

import numpy as np

from hmcvt_core.identification.problem import Problem
from hmcvt_core.model.accuracy import relative_errors

from . import paper
from .bench import lowest, problem, table2
from .item import Item, claim
from .tables import FORMULATIONS

GROUP = "Conclusion 1: five tests are enough"
FEWEST = 3


@dataclass(frozen=True)
class SubsetFit:
    """One fit to some of the tests.

    Attributes:
        formulation: of the model.
        tests: numbers from 1.
        fit_error: mean |predicted - measured| / measured over them [%].
        prediction_error: over the other tests; NaN when there are none, infinite when the
            formulation has no answer at one of them.
        objective: value reached, as `Problem.objective` has it.
    """

    formulation: str
    tests: tuple[int, ...]
    fit_error: float
    prediction_error: float
    objective: float


def subsets() -> list[tuple[int, ...]]:
    """Test numbers of every subset."""
    numbers = range(1, len(table2()) + 1)
    return [
        subset
        for size in range(FEWEST, len(numbers) + 1)
        for subset in itertools.combinations(numbers, size)
    ]


def tasks() -> list[tuple[str, tuple[int, ...]]]:
    """Every fit."""
    return [
        (formulation, subset) for formulation in FORMULATIONS for subset in subsets()
    ]


def fit(task: tuple[str, tuple[int, ...]]) -> SubsetFit:
    """Fit one subset and predict the other tests."""
    formulation, subset = task
    tests, whole = np.array(subset) - 1, problem(formulation)
    some = Problem(whole.model, table2().select(tests))
    found = lowest(some.objective)
    relative = 100.0 * relative_errors(whole.predict(found), table2().efficiency)
    rest = np.setdiff1d(np.arange(len(relative)), tests)
    held = (
        float(np.nan_to_num(relative[rest], nan=np.inf).mean()) if len(rest) else np.nan
    )
    return SubsetFit(
        formulation,
        subset,
        float(relative[tests].mean()),
        held,
        float(some.objective(found)),
    )


def items(fits: list[SubsetFit]) -> list[Item]:
    """Whether any five tests do, and what a sixth or seventh adds."""
    return [
        item
        for formulation in reversed(FORMULATIONS)
        for item in _items(fits, formulation)
    ]


def _items(fits: list[SubsetFit], formulation: str) -> list[Item]:
    limit = paper.TABLE_3[paper.BEST_GEAR_EFFICIENCY].prediction
    five, seven = (
        np.array(
            [
                each.prediction_error
                for each in fits
                if each.formulation == formulation and len(each.tests) == size
            ]
        )
        for size in (5, 7)
    )
    low, middle, high = np.percentile(five, (25, 50, 75), method="nearest")
    up_to = f"{high:.2f}" if np.isfinite(high) else "no answer"
    within = int((five <= limit).sum())
    most = float(np.percentile(seven, 50, method="nearest"))
    missing = int(np.isinf(five).sum())
    worst = f"worst {five.max():.2f}" if not missing else f"no answer in {missing}"
    return [
        claim(
            GROUP,
            f"any five tests predict the other three to {limit:g} %, {formulation}",
            f"{limit:.2f} %",
            f"median {middle:.2f} % ({low:.2f} to {up_to}), {worst}",
            within == len(five),
            why=f"{within} of {len(five)} choices of five do",
        ),
        claim(
            GROUP,
            f"more than five tests bring nothing, {formulation}",
            "five suffice",
            f"median error with 7: {most:.2f} %, with 5: {middle:.2f} %",
            middle < 1.2 * most,
            why="two more tests lower the error by more than a fifth",
            remark="two more tests lower the error by less than a fifth",
        ),
    ]

# SPDX-License-Identifier: Apache-2.0
"""Conclusions 1 to 3 of the paper as checks that can fail; the fourth has its own module."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from . import paper
from .bench import table2
from .item import Item, claim, printed_error
from .subsets import GROUP as FIVE
from .tables import FORMULATIONS, Fit

IDENTIFICATION = "Conclusion 2: accurate identification"
AT_REST = "Conclusion 3: equal efficiency at eps = 0"


def items(fits: dict[tuple[str, float], Fit]) -> list[Item]:
    """Errors of the paper's own split, and efficiencies at eps = 0."""
    theirs = paper.TABLE_3[paper.BEST_GEAR_EFFICIENCY]
    found = []
    for name in reversed(FORMULATIONS):
        ours = fits[name, paper.BEST_GEAR_EFFICIENCY].errors
        found += [
            printed_error(FIVE, f"error of tests 3, 7, 8 from the other five, {name} [%]",
                          theirs.prediction, ours.prediction),
            printed_error(IDENTIFICATION, f"error of the identification, {name} [%]",
                          theirs.identification, ours.identification),
        ]
    return [*found, *(_model(fits, name) for name in FORMULATIONS), _bench(), _level(fits)]


def _at_rest() -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
    return np.flatnonzero(table2().displacement_ratio == 0.0)


def _model(fits: dict[tuple[str, float], Fit], name: str) -> Item:
    """Equal means: closer than the bench could tell."""
    values = 100.0 * fits[name, paper.BEST_GEAR_EFFICIENCY].predicted[_at_rest()]
    limit = paper.Uncertainties().total
    return claim(AT_REST, f"model, tests 6, 7, 8, {name} [%]", "82.55, 82.56, 82.54",
                 ", ".join(f"{value:.2f}" for value in values), float(np.ptp(values)) < limit,
                 why="pump drag is paid at eps = 0 too, and weighs less as the load rises",
                 remark=f"they differ by less than the measurement uncertainty of {limit} %")


def _bench() -> Item:
    """Chi-square of the three readings about their mean, with the paper's own uncertainty."""
    values = 100.0 * table2().efficiency[_at_rest()]
    deviation = values * paper.Uncertainties().total / 100.0
    mean = np.average(values, weights=deviation**-2)
    chance = float(chi2.sf(np.sum(((values - mean) / deviation) ** 2), len(values) - 1))
    return claim(
        AT_REST, "bench, tests 6, 7, 8 [%]", "approximately equal",
        ", ".join(f"{value:.1f}" for value in values), chance > 0.05,
        why=f"with an uncertainty of {paper.Uncertainties().total} % equal values would scatter so "
        f"in {100 * chance:.1f} % of cases (chi-square)")


def _level(fits: dict[tuple[str, float], Fit]) -> Item:
    """The paper takes 0.98 because it meets the measured mean at eps = 0 best."""
    mean = 100.0 * float(table2().efficiency[_at_rest()].mean())
    found = {gear: 100.0 * float(fits["published", gear].predicted[_at_rest()].mean())
             for gear in paper.GEAR_EFFICIENCIES}
    best = min(found, key=lambda gear: abs(found[gear] - mean))
    target = paper.BEST_GEAR_EFFICIENCY
    return claim(
        AT_REST, "gear efficiency that meets the measured mean at eps = 0 best", f"{target:g}",
        f"{best:g}", best == target,
        why=f"measured mean {mean:.2f} %, {found[best]:.2f} % with {best:g}, {found[target]:.2f} % "
        f"with {target:g}")

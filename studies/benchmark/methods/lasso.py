# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""LASSO on signatures, its penalty by BIC; probabilities by how often resampled rows agree."""

import warnings
from collections import Counter

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LassoLarsIC

from studies.benchmark.answer import Answer
from studies.benchmark.case import Case, FloatArray
from studies.benchmark.methods.linear import (
    MAX_EFFECTS,
    UNLISTED,
    Linear,
    linear,
    name_of,
    part_of,
)

RESAMPLED = 30
MIN_SHARE = 0.1
"""Of the largest contribution: below it, a column does not count as an effect."""


def answer(case: Case) -> Answer:
    """Select signatures by LASSO and refit those that it selects."""
    problem = linear(case)
    rows = np.arange(len(problem.left_residual))
    chosen = selected(problem, rows)
    rng = np.random.default_rng(0)
    counts = Counter([names(problem, chosen)])
    for _ in range(RESAMPLED):
        counts[names(problem, selected(problem, rng.choice(rows, len(rows))))] += 1
    prediction, deviation, fit = problem.predicted(chosen)
    inadequate = problem.inadequate(fit)
    unlisted = UNLISTED if inadequate else 1.0 - UNLISTED
    scale = (1.0 - unlisted) / (RESAMPLED + 1)
    no_gap = scale * counts.pop((), 0)
    verdict = "listed" if chosen else "no_gap"
    if inadequate:
        verdict = "unlisted"
    ranked = [(found, scale * count) for found, count in counts.most_common()]
    # The selection on all readings leads; it is at least as probable as any other.
    ranked.sort(key=lambda item: item[0] != names(problem, chosen))
    if chosen:
        ranked[0] = (ranked[0][0], max(probability for _, probability in ranked))
    total = no_gap + unlisted + sum(probability for _, probability in ranked)
    return Answer(
        case=case.name,
        method="",
        verdict=verdict,
        sets=tuple(
            (found, probability / max(total, 1.0)) for found, probability in ranked[:10]
        ),
        no_gap_probability=no_gap / max(total, 1.0),
        unlisted_probability=unlisted / max(total, 1.0),
        part=part_of(problem.labels[chosen[0]]) if chosen else None,
        promised=1.0 - fit.chi2 / problem.fit(()).chi2 if chosen else None,
        gap=tuple((prediction - case.model_at_points.base).tolist()),
        gap_deviation=tuple(deviation.tolist()),
        prediction=tuple(prediction.tolist()),
    )


def selected(problem: Linear, rows: FloatArray) -> tuple[int, ...]:
    """Return the columns that LASSO selects on some rows, one an effect, largest first."""
    columns = problem.left_signatures[rows]
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-9)
    lasso = LassoLarsIC("bic", positive=True, noise_variance=1.0, fit_intercept=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        lasso.fit(columns / scale, problem.left_residual[rows])
    contribution = lasso.coef_
    best: dict[str, int] = {}
    for index in np.argsort(-contribution):
        if contribution[index] > MIN_SHARE * np.max(contribution):
            best.setdefault(name_of(problem.labels[index]), int(index))
    return tuple(best.values())[:MAX_EFFECTS]


def names(problem: Linear, chosen: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of the effects of columns."""
    return tuple(sorted(name_of(problem.labels[i]) for i in chosen))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Forward selection of signatures by BIC (Schwarz 1978)."""

import numpy as np

from studies.benchmark.answer import Answer
from studies.benchmark.case import Case
from studies.benchmark.methods.linear import (
    MAX_EFFECTS,
    UNLISTED,
    Linear,
    effect_of,
    linear,
    name_of,
    part_of,
)


def answer(case: Case) -> Answer:
    """Add the signature that lowers BIC most, until none does."""
    problem = linear(case)
    chosen: tuple[int, ...] = ()
    visited = {chosen: bic(problem, chosen)}
    while len(chosen) < MAX_EFFECTS:
        taken = {name_of(problem.labels[i]) for i in chosen}
        scores = {}
        for column, label in enumerate(problem.labels):
            if name_of(label) not in taken:
                scores[(*chosen, column)] = bic(problem, (*chosen, column))
        visited.update(scores)
        best = min(scores, key=lambda columns: scores[columns])
        if scores[best] >= visited[chosen]:
            break
        chosen = best
    prediction, deviation, fit = problem.predicted(chosen)
    inadequate = problem.inadequate(fit)
    weights: dict[tuple[str, ...], float] = {}
    lowest = min(visited.values())
    for columns, score in visited.items():
        names = tuple(sorted(effect_of(problem.labels[i]) for i in columns))
        weights[names] = max(weights.get(names, 0.0), np.exp(0.5 * (lowest - score)))
    unlisted = UNLISTED if inadequate else 1.0 - UNLISTED
    scale = (1.0 - unlisted) / sum(weights.values())
    no_gap = scale * weights.pop(())
    ranked = sorted(weights.items(), key=lambda item: -item[1])[:10]
    verdict = "listed" if chosen else "no_gap"
    return Answer(
        case=case.name,
        method="",
        verdict="unlisted" if inadequate else verdict,
        sets=tuple((names, float(scale * weight)) for names, weight in ranked),
        no_gap_probability=float(no_gap),
        unlisted_probability=unlisted,
        part=part_of(problem.labels[chosen[0]]) if chosen else None,
        promised=1.0 - fit.chi2 / problem.fit(()).chi2 if chosen else None,
        gap=tuple((prediction - case.model_at_points.base).tolist()),
        gap_deviation=tuple(deviation.tolist()),
        prediction=tuple(prediction.tolist()),
    )


def bic(problem: Linear, chosen: tuple[int, ...]) -> float:
    """Return BIC of a set of signatures; the scale of the noise is fitted."""
    count = len(problem.residual)
    squares = problem.fit(chosen).chi2
    return float(count * np.log(squares / count) + len(chosen) * np.log(count))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Boosted trees of the residual efficiency, and the signature nearest to it."""

import numpy as np
from sklearn.ensemble import GradientBoostingRegressor
from sklearn.model_selection import KFold, cross_val_predict

from studies.benchmark.answer import Answer
from studies.benchmark.case import Case
from studies.benchmark.methods.linear import linear, nearest_answer, scaled_axes

TREES = 100
DEPTH = 2
RATE = 0.1
SUBSAMPLE = 0.7
FOLDS = 5
MIN_EXPLAINED = 0.1
"""Fraction of the squared residual that held-out tests must give for a gap to be reported."""


def answer(case: Case) -> Answer:
    """Boost trees on the residual; cross-validation says how far to trust them."""
    problem = linear(case)
    tests, points = scaled_axes(case)
    noise = problem.efficiency_noise
    residual = problem.efficiency_residual
    trees = GradientBoostingRegressor(
        n_estimators=TREES,
        max_depth=DEPTH,
        learning_rate=RATE,
        subsample=SUBSAMPLE,
        random_state=0,
    )
    folds = KFold(FOLDS, shuffle=True, random_state=0)
    held_out = cross_val_predict(trees, tests, residual, cv=folds)
    error = np.mean((residual - held_out) ** 2)
    explained = 1.0 - error / np.mean(residual**2)
    trees.fit(tests, residual)
    gap = trees.predict(points)
    has_gap = bool(explained > MIN_EXPLAINED)
    if not has_gap:
        gap = np.zeros(len(gap))
    # What the held-out error has beyond the noise is error of the trees.
    spread = np.sqrt(max(error - np.mean(noise**2), 1e-8))
    change = problem.change(held_out)
    deviation = np.full(len(gap), spread)
    promised = 1.0 - spread**2 / max(np.mean(residual**2) - np.mean(noise**2), 1e-8)
    prediction = case.model_at_points.base + gap
    return nearest_answer(
        problem, change, has_gap, prediction, deviation, float(promised)
    )

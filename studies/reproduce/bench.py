# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The paper's bench and its split, and the search that finds the lowest point of a fit."""

import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from hmcvt_core.files import data_path
from hmcvt_core.files.bench import BenchSamples, read_bench
from hmcvt_core.identification.problem import Problem
from hmcvt_core.model.accuracy import relative_errors
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import load_stage
from hmcvt_core.transmission.parameters import PAPER_PARAMETERS
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS as BOUNDS
from hmcvt_core.transmission.stage import Stage

from . import paper

Array = NDArray[np.float64]
FITTED = np.array(paper.FITTED_TESTS) - 1
PREDICTED = np.array(paper.PREDICTED_TESTS) - 1
_LOOKS, _POPULATION = 12, 60  # 4096 points, and how many of them the search begins with
_NOTHING = 1e9  # stands for "no answer"


@functools.cache
def table2() -> BenchSamples:
    """The eight bench tests."""
    return read_bench(data_path("data/table2.csv"))


@functools.cache
def stage(gear_efficiency: float = paper.BEST_GEAR_EFFICIENCY) -> Stage:
    """Stage HM4 with one efficiency in every gear pair."""
    return load_stage(data_path("params/transmission.yaml")).with_gear_efficiency(
        gear_efficiency
    )


def problem(
    formulation: str, gear_efficiency: float = paper.BEST_GEAR_EFFICIENCY
) -> Problem:
    """All eight tests as an identification problem."""
    model = EfficiencyModel(stage(gear_efficiency), PAPER_PARAMETERS[0.98], formulation)
    return Problem(model, table2())


def relative_squares(predicted: Array, measured: Array) -> Array:
    """Mean squared relative error: weighted squares with one relative deviation for all tests."""
    return np.asarray(np.mean(relative_errors(predicted, measured) ** 2, axis=-1))


def mean_error(predicted: Array, measured: Array) -> Array:
    """Mean |predicted - measured| / measured."""
    return np.asarray(np.mean(relative_errors(predicted, measured), axis=-1))


def lowest(objective: Callable[[Array], Array], box: Array = BOUNDS) -> Array:
    """Return where in a box of scaled parameters an objective is lowest, shape (3,).

    It is `identify`'s aim by cheaper means, for hundreds of fits, and the same in every run.

    Args:
        objective: values (m,) at points (m, 3); NaN where there is no answer.
        box: shape (3, 2).
    """

    def values(columns: Array) -> Array:
        return np.nan_to_num(objective(columns.T), nan=_NOTHING, posinf=_NOTHING)

    points = box[:, 0] + np.ptp(box, axis=1) * qmc.Sobol(
        3, scramble=False
    ).random_base2(_LOOKS)
    # From the best few the search does not settle in the first valley that it meets.
    best = points[np.argsort(values(points.T))[:_POPULATION]]
    found: Array = differential_evolution(
        values,
        box,
        init=best,
        vectorized=True,
        polish=False,
        updating="deferred",
        tol=1e-9,
        rng=0,
    ).x
    return found

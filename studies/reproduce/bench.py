# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The paper's bench and its split, and the search that finds the lowest point of a fit.

The search is `identify`'s aim by cheaper means, for hundreds of fits: the best few of a fixed cloud
of points, each finished by least squares, or by a simplex where the objective is no sum of squares.
Predictions at the cloud are shared by all fits of one model.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize
from scipy.stats import qmc

from hmcvt_core.files import data_path
from hmcvt_core.files.bench import BenchSamples, read_bench
from hmcvt_core.identification.problem import Problem
from hmcvt_core.model.agreement import determination_loss, relative_errors
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import load_stage
from hmcvt_core.transmission.parameters import PAPER_PARAMETERS
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS as BOUNDS
from hmcvt_core.transmission.stage import Stage

from . import paper

Array = NDArray[np.float64]
Objective = Callable[[Array, Array], Array]
"""Predicted (m, n) and measured (n,) efficiencies in, values (m,) out; NaN is infinitely bad."""

FITTED = np.array(paper.FITTED_TESTS) - 1
PREDICTED = np.array(paper.PREDICTED_TESTS) - 1
_CLOUD_POWER = 12  # 4096 points
_POLISHED = 3
_NOTHING = 1e9  # stands for "no answer", which a simplex cannot handle


@functools.cache
def table2() -> BenchSamples:
    """The eight bench tests."""
    return read_bench(data_path("data/table2.csv"))


@functools.cache
def stage(gear_efficiency: float = paper.BEST_GEAR_EFFICIENCY) -> Stage:
    """Stage HM4 with one efficiency in every gear pair."""
    return load_stage(data_path("params/transmission.yaml")).with_gear_efficiency(gear_efficiency)


def problem(formulation: str, gear_efficiency: float = paper.BEST_GEAR_EFFICIENCY) -> Problem:
    """All eight tests as an identification problem."""
    model = EfficiencyModel(stage(gear_efficiency), PAPER_PARAMETERS[0.98], formulation)
    return Problem(model, table2())


def relative_squares(predicted: Array, measured: Array) -> Array:
    """Mean squared relative error: weighted squares with one relative deviation for all tests."""
    return np.asarray(np.mean(relative_errors(predicted, measured) ** 2, axis=-1))


def mean_error(predicted: Array, measured: Array) -> Array:
    """Mean |predicted - measured| / measured."""
    return np.asarray(np.mean(relative_errors(predicted, measured), axis=-1))


OBJECTIVES = {"power_balance": relative_squares, "published": determination_loss}
"""What `identify` minimises, but for a constant factor."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points in a box of scaled parameters, and what a model predicts there.

    Attributes:
        problem: all tests.
        box: shape (3, 2).
        points: shape (m, 3).
        predicted: shape (m, 8); NaN where there is no answer.
    """

    problem: Problem
    box: Array
    points: Array
    predicted: Array

    @classmethod
    def of(cls, problem: Problem, box: Array = BOUNDS) -> Cloud:
        """Spread points evenly (Sobol sequence, always the same)."""
        unit = qmc.Sobol(len(box), scramble=False).random_base2(_CLOUD_POWER)
        points = box[:, 0] + (box[:, 1] - box[:, 0]) * unit
        return cls(problem, box, points, problem.predict(points))

    def lowest(self, objective: Objective, tests: NDArray[np.intp]) -> Array:
        """Return the scaled parameters, shape (3,), that fit the given tests best."""
        measured = self.problem.samples.efficiency[tests]
        values = np.nan_to_num(objective(self.predicted[:, tests], measured), nan=np.inf)
        # The simplex follows the edge at which the published formulas contradict themselves.
        finish = self._least_squares if objective is relative_squares else self._simplex
        ends = np.array([finish(self.points[i], objective, tests) for i in self._apart(values)])
        reached = objective(self.problem.predict(ends)[:, tests], measured)
        best: Array = ends[int(np.nan_to_num(reached, nan=np.inf).argmin())]
        return best

    def _simplex(self, start: Array, objective: Objective, tests: NDArray[np.intp]) -> Array:
        measured = self.problem.samples.efficiency[tests]

        def value(scaled: Array) -> float:
            found = float(objective(self.problem.predict(scaled)[tests], measured))
            return found if np.isfinite(found) else _NOTHING

        end: Array = minimize(value, start, method="Nelder-Mead", bounds=self.box,
                              options={"xatol": 1e-5, "fatol": 1e-9, "maxfev": 600}).x
        return end

    def _least_squares(self, start: Array, _: Objective, tests: NDArray[np.intp]) -> Array:
        measured = self.problem.samples.efficiency[tests]

        def residuals(scaled: Array) -> Array:
            return np.nan_to_num(self.problem.predict(scaled)[tests] / measured - 1.0, nan=1.0)

        end: Array = least_squares(residuals, start, bounds=self.box.T).x
        return end

    def _apart(self, values: Array) -> list[int]:
        """The best points that are not neighbours: one for each valley, as far as they show."""
        chosen: list[int] = []
        width = self.box[:, 1] - self.box[:, 0]
        for i in np.argsort(values)[:400].tolist():
            near = [np.abs((self.points[i] - self.points[j]) / width).max() < 0.15 for j in chosen]
            if not any(near):
                chosen.append(i)
            if len(chosen) == _POLISHED:
                break
        return chosen

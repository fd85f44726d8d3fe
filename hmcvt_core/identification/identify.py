# SPDX-License-Identifier: Apache-2.0
"""Identification: bench samples in, model out."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from ..files.bench import BenchSamples
from ..files.resources import data_path
from ..model.domain import Domain
from ..model.model import EfficiencyModel
from ..model.parameter_file import load_stage, save_model
from ..model.plausibility import output_speed_remark
from ..model.relative_error import RelativeError
from ..physics.effects.base import Effect
from ..transmission.parameters import PAPER_PARAMETERS, HydraulicParameters
from ..transmission.stage import Stage
from ..version import __version__
from . import annealing
from .annealing import AnnealingState, Schedule
from .polish import least_squares_polish, simplex_polish
from .precision import Precision, extrapolated, findings, precision, unanswered
from .problem import BOUNDS, Problem, relative_error, to_parameters
from .two_part import HydraulicRoots, hydraulic_roots, starting_points

Array = NDArray[np.float64]
Progress = Callable[[AnnealingState], None]

SCHEDULES = {
    # One smooth valley, as a rule: many short chains see whether there is another.
    "power_balance": Schedule(chains=32, moves=1, final_temperature=0.5),
    # Local minima, and regions without any answer: long chains.
    "published": Schedule(chains=16, moves=20),
}
"""The improved annealing of section 4.1, as chains side by side, by formulation."""

OBJECTIVES = {"power_balance": "weighted squares", "published": "1 - RSQ, eq. (21)"}
_POLISHED = 4  # chain ends that a local search finishes


@dataclass(frozen=True, eq=False)
class Identification:
    """Outcome of an identification.

    Attributes:
        model: the identified model; carries errors, domain and provenance.
        samples: those it was fitted to.
        residuals: predicted - measured efficiency at them, shape (n,) [-].
        fit_error: mean |predicted - measured| / measured over them [-].
        prediction_error: the same over the samples held back at which the model has an answer, or
            None.
        objective: value reached; `objective_name` says of what.
        history: best objective after each temperature step, then after the local search.
        evaluations: candidates evaluated by the annealing.
        stop_reason: of the annealing.
        seed: of the random numbers.
        warnings: plain sentences on what the samples leave open.
        roots: hydraulic efficiencies of part 1 by sample (`published` only).
    """

    model: EfficiencyModel
    samples: BenchSamples
    residuals: Array
    fit_error: float
    prediction_error: float | None
    objective: float
    objective_name: str
    history: tuple[float, ...]
    evaluations: int
    stop_reason: str
    seed: int | None
    warnings: tuple[str, ...]
    roots: tuple[HydraulicRoots, ...] = ()

    @property
    def parameters(self) -> HydraulicParameters:
        """The identified parameters."""
        return self.model.parameters

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each parameter, in its unit."""
        return dict(self.model.standard_errors)

    @property
    def correlation(self) -> Array:
        """Correlation of the parameters, shape (3, 3)."""
        return np.asarray(self.model.correlation)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the parameter file, whole or not at all."""
        save_model(self.model, path)

    def report(self, numbers: Sequence[int] | None = None) -> str:
        """Return the outcome as text for a person.

        Args:
            numbers: of the samples in their file; 1, 2, ... when left out.
        """
        from .report import report

        return report(self, numbers)

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome as plain data."""
        from .report import to_dict

        return to_dict(self)


def identify(
    samples: BenchSamples,
    *,
    stage: Stage | None = None,
    formulation: str = "power_balance",
    gear_efficiency: float | None = None,
    effects: Sequence[Effect] = (),
    validation: BenchSamples | None = None,
    schedule: Schedule | None = None,
    seed: int | None = 0,
    progress: Progress | None = None,
) -> Identification:
    """Identify the three hydraulic parameters from bench samples by improved annealing.

    `power_balance` minimises the mean of weighted squares (weights from `efficiency_std`, else the
    paper's 1.12 %); `published` maximises RSQ, eq. (21), in the paper's two parts. The annealing
    looks for the valley, a local search finishes it.

    Args:
        samples: at least one bench sample.
        stage: gear train; None for stage HM4 of the paper.
        formulation: `power_balance` or `published`.
        gear_efficiency: of every pair [-]; None keeps those of the stage.
        effects: effects with fixed parameters that act besides.
        validation: samples held back, to predict.
        schedule: of the annealing; None for that of `SCHEDULES`.
        seed: of the random numbers.
        progress: called after each temperature step; may raise to cancel.

    Raises:
        InputError: an argument is out of range.
        IdentificationError: no parameters give an answer at every sample.
    """
    model = EfficiencyModel(_stage(stage, gear_efficiency), PAPER_PARAMETERS[0.98], formulation,
                            tuple(effects))
    problem = Problem.of(model, samples)
    schedule = SCHEDULES[formulation] if schedule is None else schedule
    roots: list[HydraulicRoots] = []
    if formulation == "published":
        roots = hydraulic_roots(model.stage, samples)
        objective, starts = problem.determination_loss, starting_points(problem, roots)
    else:
        objective, starts = problem.weighted_squares, None
    annealed = annealing.minimise(
        objective, BOUNDS, schedule=schedule, seed=seed, progress=progress,
        start=_starts(starts, schedule.chains, seed))
    ends = annealed.ends[:_POLISHED]
    scaled, value = (least_squares_polish(problem, ends) if formulation == "power_balance"
                     else simplex_polish(objective, ends))
    if not np.isfinite(value):
        raise IdentificationError(
            f"{samples.source}: no parameters within the bounds give an efficiency at every "
            "sample: check stage, units and load torque")
    found = precision(problem, scaled)
    held = None if validation is None else Problem.of(model, validation)
    held_error = None if held is None else relative_error(held, scaled)
    predicted = problem.predict(scaled)
    fit_error = RelativeError.of(predicted, samples.efficiency).mean
    fitted = _fitted(problem, scaled, found, seed, value, fit_error, held, held_error)
    warnings = findings(problem, scaled, found)
    remark = output_speed_remark(fitted.stage, samples)
    if remark is not None:
        warnings += (remark,)
    if held is not None and held_error is not None:
        warnings += (*unanswered(held, held_error), *extrapolated(held, samples))
    return Identification(
        fitted, samples, predicted - samples.efficiency, fit_error,
        fitted.provenance.get("prediction_error"),
        value, OBJECTIVES[formulation], (*annealed.history, value), annealed.evaluations,
        annealed.stop_reason, seed, warnings, tuple(roots),
    )


def identify_gear_efficiency(
    samples: BenchSamples, efficiencies: Sequence[float], **options: Any
) -> list[Identification]:
    """Identify once for each gear efficiency (the paper's enumeration, Table 3)."""
    return [identify(samples, gear_efficiency=value, **options) for value in efficiencies]


def _stage(stage: Stage | None, gear_efficiency: float | None) -> Stage:
    stage = _paper_stage() if stage is None else stage
    return stage if gear_efficiency is None else stage.with_gear_efficiency(gear_efficiency)


@cache
def _paper_stage() -> Stage:
    return load_stage(data_path("params/transmission.yaml"))


def _starts(starts: Array | None, chains: int, seed: int | None) -> Array | None:
    """One row per chain: the starts given, then random points."""
    if starts is None:
        return None
    rng = np.random.default_rng(seed)
    fill = BOUNDS[:, 0] + (BOUNDS[:, 1] - BOUNDS[:, 0]) * rng.random((chains, len(BOUNDS)))
    return np.concatenate([starts[: max(1, chains // 2)], fill])[:chains]


def _fitted(
    problem: Problem,
    scaled: Array,
    found: Precision,
    seed: int | None,
    value: float,
    fit_error: float,
    held: Problem | None,
    held_error: RelativeError | None,
) -> EfficiencyModel:
    samples, formulation = problem.samples, problem.model.formulation
    provenance: dict[str, Any] = {
        "source": f"hmcvt identify, version {__version__}",
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "data": Path(samples.source).name,
        "data_sha256": samples.sha256,
        "samples": len(samples),
        "seed": seed,
        "objective": OBJECTIVES[formulation],
        "objective_value": float(f"{value:.9g}"),
        "fit_error": float(f"{fit_error:.6g}"),
    }
    if held is not None and held_error is not None:
        if np.isfinite(held_error.mean):
            provenance["prediction_error"] = float(f"{held_error.mean:.6g}")
        provenance["validation_samples"] = len(held.samples)
        if held_error.without_answer:
            provenance["validation_without_answer"] = held_error.without_answer
    return replace(
        problem.model, parameters=to_parameters(scaled), standard_errors=found.standard_errors,
        correlation=found.correlation, domain=Domain.of(samples), provenance=provenance)

# SPDX-License-Identifier: Apache-2.0
"""Identification: bench samples in, model out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from ..files.bench import BenchSamples
from ..files.resources import data_path
from ..model.agreement import RelativeError, output_speed_remark
from ..model.domain import Domain
from ..model.model import EfficiencyModel
from ..model.parameter_file import load_stage
from ..physics.effects.base import Effect
from ..transmission.parameters import (
    PAPER_PARAMETERS,
    SEARCH_BOUNDS,
    HydraulicParameters,
    from_scaled,
)
from ..transmission.stage import Stage
from ..version import __version__
from . import annealing
from .annealing import AnnealingRun, Schedule, with_steps
from .problem import OBJECTIVES, Problem, findings, precision, unchecked
from .result import Identification
from .two_part import HydraulicRoots, hydraulic_roots, starting_points

Array = NDArray[np.float64]
Progress = Callable[[AnnealingRun], None]

SCHEDULES = {
    # Ends within 1 % of the lowest objective by itself (docs/theory.md).
    "power_balance": Schedule(chains=40, moves=6),
    # Regions without any answer: long chains, whose moves stay wide until (20) ends the run.
    "published": Schedule(chains=16, moves=20, shrink=with_steps),
}
"""The improved annealing of section 4.1, as chains side by side, by formulation."""

_MOST_ANNEALED = 500  # samples that the annealing looks at: it costs 13,600 predictions of each
_FINISHED = 4  # chain ends that a local search finishes: a second valley may be as deep


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
    finds the parameters, a local search gives them their last digits.

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
    if stage is None:
        stage = load_stage(data_path("params/transmission.yaml"))
    if gear_efficiency is not None:
        stage = stage.with_gear_efficiency(gear_efficiency)
    model = EfficiencyModel(stage, PAPER_PARAMETERS[0.98], formulation, tuple(effects))
    problem = Problem(model, samples)
    schedule = SCHEDULES[formulation] if schedule is None else schedule
    roots: list[HydraulicRoots] = []
    start = None
    if formulation == "published":
        roots = hydraulic_roots(model.stage, samples)
        start = _filled(starting_points(problem, roots), schedule.chains, seed)
    annealed = annealing.minimise(
        Problem(model, _thinned(samples)).objective, SEARCH_BOUNDS, schedule=schedule, start=start,
        seed=seed, progress=progress)
    scaled, value = problem.finish(annealed.ends[:_FINISHED])
    if not np.isfinite(value):
        raise IdentificationError(
            f"{samples.source}: no parameters within the bounds give an efficiency at every "
            "sample: check stage, units and load torque")
    standard_errors, correlation = precision(problem, scaled)
    predicted = problem.predict(scaled)
    fit_error = RelativeError.of(predicted, samples.efficiency).mean
    remark = output_speed_remark(model.stage, samples)
    warnings = [*findings(samples, scaled, standard_errors, correlation),
                *([] if remark is None else [remark])]
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
    if validation is not None:
        held = Problem(model, validation)
        error = RelativeError.of(held.predict(scaled), validation.efficiency)
        if np.isfinite(error.mean):
            provenance["prediction_error"] = float(f"{error.mean:.6g}")
        provenance["validation_samples"] = len(validation)
        if error.without_answer:
            provenance["validation_without_answer"] = error.without_answer
        warnings += unchecked(held, error, samples)
    identified = replace(
        model, parameters=HydraulicParameters(*from_scaled(scaled).tolist()),
        standard_errors=standard_errors, correlation=correlation, domain=Domain.of(samples),
        provenance=provenance)
    return Identification(
        identified, samples, predicted - samples.efficiency, fit_error,
        provenance.get("prediction_error"), value, float(problem.objective(annealed.ends[0])),
        OBJECTIVES[formulation], (*annealed.history, value), annealed.evaluations,
        annealed.stop_reason, seed, tuple(warnings), tuple(roots))


def _thinned(samples: BenchSamples) -> BenchSamples:
    """As many samples as the annealing looks at, spread over the displacement ratio."""
    if len(samples) <= _MOST_ANNEALED:
        return samples
    order = np.argsort(samples.displacement_ratio, kind="stable")
    return samples.select(order[np.linspace(0, len(order) - 1, _MOST_ANNEALED).astype(int)])


def _filled(starts: Array, chains: int, seed: int | None) -> Array:
    """One row per chain: starts for half of them, then random points."""
    low, high = SEARCH_BOUNDS.T
    fill = np.random.default_rng(seed).uniform(low, high, (chains, len(low)))
    return np.concatenate([starts[: max(1, chains // 2)], fill])[:chains]

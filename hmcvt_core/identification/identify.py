# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification: bench samples in, a model out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ..errors import IdentificationError, InputError
from ..files import data_path
from ..files.bench import BenchSamples
from ..files.checks import one_holdout, require_seed
from ..model.accuracy import mean_error
from ..model.checks import require_samples
from ..model.domain import Domain
from ..model.model import EfficiencyModel
from ..model.parameter_file import load_stage
from ..model.part_checks import require_effects, require_stages
from ..model.staged_samples import by_stage
from ..physics.effects.base import Effect
from ..physics.formulation import POWER_BALANCE, PUBLISHED
from ..transmission.parameters import (
    PAPER_PARAMETERS,
    PARAMETER_NAMES,
    PARAMETER_UNITS,
    SEARCH_BOUNDS,
    HydraulicParameters,
)
from ..transmission.ranges import EFFICIENCY_STD, Array
from ..transmission.stage import Stage
from . import annealing
from .annealing import AnnealingRun, Schedule, with_steps
from .campaign import Campaign, origin
from .cross_validation import folds
from .misfit import FEWEST, misfit_remarks, with_misfit
from .piecewise import HydraulicRoots, chain_starts, hydraulic_roots
from .precision import degrees_of_freedom, precision
from .problem import Problem
from .profile import profile_intervals
from .remarks import unchecked, undetermined
from .result import Identification
from .robust import thinned, thinned_rows

SCHEDULES: Mapping[str, Schedule] = {
    # Ends within 0.01 % of the lowest objective by itself (`python -m studies.annealing`).
    POWER_BALANCE.name: Schedule(chains=22, moves=6, rounds=3, together=True),
    # Regions without any answer: long chains, whose moves stay wide until (20) ends the run.
    PUBLISHED.name: Schedule(chains=16, moves=20, shrink=with_steps),
}
"""The improved annealing of section 4.1, as chains side by side, by formulation."""

_FINISHED = 4
"""Chain ends that a local search finishes: a second valley may be as deep."""


def identify(
    samples: BenchSamples,
    *,
    stage: Stage | Sequence[Stage] | None = None,
    formulation: str = "power_balance",
    gear_efficiency: float | None = None,
    effects: Sequence[Effect] = (),
    holdout: BenchSamples | None = None,
    noise: float | None = None,
    schedule: Schedule | None = None,
    seed: int | None = 0,
    progress: Callable[[AnnealingRun], None] | None = None,
    validation: BenchSamples | None = None,
) -> Identification:
    """Identify the three hydraulic parameters from bench samples by improved annealing.

    `power_balance` minimises the mean of weighted squares (weights from `efficiency_std`, else the
    paper's 1.12 %); `published` maximises RSQ, eq. (21), in the paper's two parts. The annealing
    finds the parameters, a local search gives them their last digits.

    `power_balance` rejects samples that disagree with the rest, as a refit does; the warnings name
    them and state the fit to all samples.

    Args:
        samples: at least one bench sample.
        stage: gear train; None for stage HM4 of the paper. Of several stages each sample names its
            own in column `stage`; pump and motor, and so the parameters, are the same in all.
        formulation: `power_balance` or `published`.
        gear_efficiency: of every pair [-]; None keeps those of the stage.
        effects: effects with fixed parameters.
        holdout: samples held out, to predict.
        noise: standard deviation of the efficiency [-]; None takes column `efficiency_std`, or the
            paper's 1.12 % of each.
        schedule: of the annealing; None for that of `SCHEDULES`.
        seed: of the random numbers.
        progress: called after each temperature step; may raise to cancel.
        validation: former name of `holdout`.

    Raises:
        InputError: an argument is out of range or of another type.
        IdentificationError: no parameters give an answer at every sample.
    """
    holdout = one_holdout(holdout, validation)
    require_samples(samples)
    if seed is not None:
        require_seed(seed)
    if holdout is not None:
        require_samples(holdout, "holdout")
    if noise is not None:
        samples = _with_noise(samples, noise)
    model = _model_to_fit(stage, formulation, gear_efficiency, effects, samples)
    # The consensus and the folds are the same wherever the annealing begins.
    fixed_seed = 0 if seed is None else seed
    campaign = Campaign.checked(model, samples, fixed_seed)
    problem = campaign.fitted
    search = _annealed(problem, schedule, seed, progress)
    scaled, value = problem.finish(search.run.ends[:_FINISHED])
    if not np.isfinite(value):
        reasons = [*campaign.contradictions, "check stage, units and load torque"]
        raise IdentificationError(
            f"{samples.source}: no parameters within the bounds give an efficiency at every "
            f"sample: {'; '.join(reasons)}"
        )
    model = _fitted_model(problem, scaled)
    # Fits of the paper's formulas take seconds, and nothing serves them.
    if formulation != PUBLISHED.name:
        model = _with_intervals(model, problem, scaled)
        if len(problem.samples) >= FEWEST:
            model = _with_misfit(model, campaign, scaled, fixed_seed)
    predicted = problem.predict(scaled)
    fit_error = mean_error(predicted, problem.samples.efficiency)
    remarks = _remarks(campaign, scaled, model)
    provenance: dict[str, Any] = {
        **origin("identify", samples, seed),
        **model.provenance,
        "objective": problem.criterion.name,
        "objective_value": float(f"{value:.9g}"),
        "fit_error": float(f"{fit_error:.6g}"),
    }
    if len(campaign.rejected):
        provenance["set_aside"] = len(campaign.rejected)
    if holdout is not None:
        errors, notes = _predicted_holdout(model, scaled, holdout)
        provenance.update(errors)
        remarks += notes
    return Identification(
        model=replace(model, provenance=provenance),
        samples=problem.samples,
        residuals=predicted - problem.samples.efficiency,
        fit_error=fit_error,
        prediction_error=provenance.get("prediction_error"),
        objective=value,
        annealing_objective=float(problem.objective(search.run.ends[0])),
        objective_name=problem.criterion.name,
        history=(*search.run.history, value),
        evaluations=search.run.evaluations,
        stop_reason=search.run.stop_reason,
        seed=seed,
        warnings=tuple(remarks),
        roots=search.roots,
        alone=_errors_by_stage(problem, scaled),
        set_aside=tuple((campaign.rejected + 1).tolist()),
        contradictions=campaign.contradictions,
    )


def _with_noise(samples: BenchSamples, noise: float) -> BenchSamples:
    """Return samples whose efficiency has one standard deviation [-]."""
    deviation = float(EFFICIENCY_STD.check(noise, "noise"))
    return replace(samples, efficiency_std=np.full(len(samples), deviation))


def _remarks(campaign: Campaign, scaled: Array, model: EfficiencyModel) -> list[str]:
    """Return sentences on contradicting, rejected and missing samples.

    Args:
        campaign: all samples.
        scaled: the best point, shape (3,).
        model: fitted to the samples that belong.
    """
    remarks = [*campaign.contradictions, *campaign.rejections]
    if len(campaign.rejected):
        remarks.append(_fit_with_all(campaign.everything, scaled))
    remarks += undetermined(campaign.fitted.samples, model)
    return remarks + misfit_remarks(model)


def _fit_with_all(problem: Problem, scaled: Array) -> str:
    """Return a sentence on the fit to all samples, the rejected ones included."""
    with_all, _ = problem.finish(scaled[None, :])
    values = problem.parameters(with_all)
    error = mean_error(problem.predict(with_all), problem.samples.efficiency)
    parts = []
    for name, value in zip(PARAMETER_NAMES, values, strict=True):
        parts.append(f"{name} {value:.4g} {PARAMETER_UNITS[name]}")
    return (
        f"with all {len(problem.samples)} samples the fit would be {', '.join(parts)}, its "
        f"error {100 * error:.2f} %"
    )


@cache
def _stage_of_the_paper() -> Stage:
    """Return stage HM4 as shipped."""
    return load_stage(data_path("params/transmission.yaml"))


def _model_to_fit(
    stage: Stage | Sequence[Stage] | None,
    formulation: str,
    gear_efficiency: float | None,
    effects: Sequence[Effect],
    samples: BenchSamples,
) -> EfficiencyModel:
    """Return the model whose parameters are to be identified."""
    require_effects(effects)
    if stage is None:
        stage = _stage_of_the_paper()
    require_stages(stage)
    stages = [stage] if isinstance(stage, Stage) else list(stage)
    if gear_efficiency is not None:
        stages = [entry.with_gear_efficiency(gear_efficiency) for entry in stages]
    named = samples.points.stage is not None
    if len(stages) > 1 and (formulation == PUBLISHED.name or not named):
        raise InputError(
            "several stages need formulation power_balance and samples with a column "
            f"stage; {samples.source} is to be fitted with "
            f"{', '.join(entry.name for entry in stages)}"
        )
    return EfficiencyModel(
        stages[0],
        PAPER_PARAMETERS[0.98],
        formulation,
        tuple(effects),
        other_stages=tuple(stages[1:]),
    )


@dataclass(frozen=True)
class _Search:
    """The annealing, and the roots of part 1 that it began from."""

    run: AnnealingRun
    roots: tuple[HydraulicRoots, ...]


def _annealed(
    problem: Problem,
    schedule: Schedule | None,
    seed: int | None,
    progress: Callable[[AnnealingRun], None] | None,
) -> _Search:
    """Look for the parameters by annealing."""
    formulation = problem.model.formulation
    if schedule is None:
        schedule = SCHEDULES[formulation]
    roots: list[HydraulicRoots] = []
    start = None
    if formulation == PUBLISHED.name:
        roots = hydraulic_roots(problem.model.stage, problem.samples)
        start = chain_starts(problem, roots, schedule.chains, seed)
    run = annealing.minimise(
        replace(problem, samples=thinned(problem.samples)).objective,
        SEARCH_BOUNDS,
        schedule=schedule,
        start=start,
        seed=seed,
        progress=progress,
    )
    return _Search(run, tuple(roots))


def _fitted_model(problem: Problem, scaled: Array) -> EfficiencyModel:
    model = replace(
        problem.model,
        parameters=HydraulicParameters(*problem.parameters(scaled).tolist()),
        domain=Domain.of(problem.samples),
    )
    free = degrees_of_freedom(problem.samples)
    return model.with_errors(*precision(problem, scaled), free)


def _with_intervals(
    model: EfficiencyModel, problem: Problem, scaled: Array
) -> EfficiencyModel:
    """Return a fitted model with intervals of its parameters by profile likelihood.

    With more samples than an annealing looks at, standard errors give the same intervals.
    """
    if thinned(problem.samples) is not problem.samples:
        return model
    errors = np.array([model.standard_errors[name] for name in PARAMETER_NAMES])
    return replace(model, intervals=profile_intervals(problem, scaled, errors))


def _with_misfit(
    model: EfficiencyModel, campaign: Campaign, scaled: Array, seed: int
) -> EfficiencyModel:
    """Return a fitted model with its form error, from refits that each leave out a fold.

    Args:
        model: fitted to the samples that belong.
        campaign: all samples.
        scaled: the best point, shape (3,).
        seed: of the folds.
    """
    rows = thinned_rows(campaign.samples)
    samples = campaign.samples.select(rows)
    belongs = campaign.belongs[rows]
    fold = np.full(len(samples), -1)
    fold[belongs] = folds(samples.select(belongs), seed)
    whole = Problem(campaign.model, samples)
    used = belongs & (fold != np.arange(fold.max() + 1)[:, None])

    def residuals(variables: Array) -> Array:
        """Residuals (m, k, n) of the refits at variables (m, k, 3)."""
        return np.where(used[:, None], whole.residuals(variables), 0.0)

    starts = np.tile(scaled, (len(used), 1))
    refits = whole.criterion.local_searches(residuals, whole.objective, starts)
    others = []
    for kept, refitted in zip(used, refits, strict=True):
        rest = Problem(campaign.model, samples.select(kept))
        others.append(_fitted_model(rest, refitted))
    return with_misfit(model, samples, belongs, fold, others)


def _errors_by_stage(problem: Problem, scaled: Array) -> dict[str, dict[str, float]]:
    """Standard errors that the samples of each stage would give by themselves."""
    parts = by_stage(problem.model, problem.samples)
    if len(parts) == 1:
        return {}
    errors = {}
    for name, part in parts.items():
        alone = replace(problem, samples=part)
        errors[name] = precision(alone, scaled, problem)[0]
    return errors


def _predicted_holdout(
    model: EfficiencyModel, scaled: Array, holdout: BenchSamples
) -> tuple[dict[str, Any], list[str]]:
    """Predict samples held out: entries of the provenance, and sentences."""
    predicted = Problem(model, holdout).predict(scaled)
    entries: dict[str, Any] = {}
    if np.isfinite(predicted).any():
        error = mean_error(predicted, holdout.efficiency)
        entries["prediction_error"] = float(f"{error:.6g}")
    entries["validation_samples"] = len(holdout)
    unanswered = int(np.isnan(predicted).sum())
    if unanswered:
        entries["validation_without_answer"] = unanswered
    return entries, list(unchecked(model, holdout, unanswered))

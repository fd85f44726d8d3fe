# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification: bench samples in; out a model, and how it was found as text and as data."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IdentificationError, InputError
from ..files import data_path, picture, preformatted
from ..files.bench import BenchSamples
from ..model.agreement import by_stage, gear_train_remarks, mean_error
from ..model.domain import Domain
from ..model.model import EfficiencyModel
from ..model.parameter_file import load_stage, save_model
from ..physics.effects.base import Effect
from ..transmission.parameters import (
    PAPER_PARAMETERS,
    SEARCH_BOUNDS,
    HydraulicParameters,
)
from ..transmission.ranges import Array
from ..transmission.stage import Stage
from ..version import __version__
from . import annealing
from .annealing import AnnealingRun, Schedule, with_steps
from .problem import (
    OBJECTIVES,
    HydraulicRoots,
    Problem,
    findings,
    hydraulic_roots,
    precision,
    starting_points,
    unchecked,
)

SCHEDULES = {
    # Ends within 1 % of the lowest objective by itself (docs/theory.md).
    "power_balance": Schedule(chains=40, moves=6),
    # Regions without any answer: long chains, whose moves stay wide until (20) ends the run.
    "published": Schedule(chains=16, moves=20, shrink=with_steps),
}
"""The improved annealing of section 4.1, as chains side by side, by formulation."""
QUICK = Schedule(chains=8, moves=2)
"""Annealing enough where only what the local search makes of it counts."""

_MOST_ANNEALED = (
    500  # samples that the annealing looks at: it costs 13,600 predictions of each
)
_FINISHED = 4  # chain ends that a local search finishes: a second valley may be as deep


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
        annealing_objective: value that the annealing reached by itself, before the finish; NaN
            where some sample had no answer there.
        history: best objective after each temperature step, then after the finish.
        evaluations: candidates evaluated by the annealing.
        stop_reason: of the annealing.
        seed: of the random numbers.
        warnings: plain sentences on what the samples leave open.
        roots: hydraulic efficiencies of part 1 by sample (`published` only).
        alone: standard errors that the samples of each stage would give by themselves, by stage
            and parameter; empty where all are of one.
    """

    model: EfficiencyModel
    samples: BenchSamples
    residuals: Array
    fit_error: float
    prediction_error: float | None
    objective: float
    annealing_objective: float
    objective_name: str
    history: tuple[float, ...]
    evaluations: int
    stop_reason: str
    seed: int | None
    warnings: tuple[str, ...]
    roots: tuple[HydraulicRoots, ...] = ()
    alone: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

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

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome as plain data for JSON."""
        return {
            "formulation": self.model.formulation,
            "stage": self.model.stage.name,
            "parameters": self.model.to_mapping()["parameters"],
            "correlation": self.correlation.tolist(),
            "samples": len(self.samples),
            "fit_error": self.fit_error,
            "prediction_error": self.prediction_error,
            "objective": {"name": self.objective_name, "value": self.objective},
            "annealing_objective": self.annealing_objective,
            "evaluations": self.evaluations,
            "stop_reason": self.stop_reason,
            "seed": self.seed,
            "residuals": self.residuals.tolist(),
            "warnings": list(self.warnings),
            **(
                {
                    "stages": {
                        name: {"standard_errors": dict(errors)}
                        for name, errors in self.alone.items()
                    }
                }
                if self.alone
                else {}
            ),
            "gear_efficiency": sorted(
                {pair.efficiency for pair in self.model.stage.gear_pairs}
            ),
        }

    def plot(self, held_back: BenchSamples | None = None) -> Any:
        """Return a matplotlib figure of measured over predicted efficiency."""
        return picture(self, held_back)

    def _repr_html_(self) -> str:
        return preformatted(self.report())

    def report(self, numbers: Sequence[int] | None = None) -> str:
        """Return the outcome as text for a person.

        Args:
            numbers: of the samples in their file; 1, 2, ... when left out.
        """
        first = gear_train_remarks(self.model, self.samples)
        return "\n".join(
            [
                *first,
                *self._result_lines(),
                *self._sample_lines(numbers),
                *(f"  note: {sentence}" for sentence in self.warnings[len(first) :]),
            ]
        )

    def _result_lines(self) -> Iterator[str]:
        model = self.model
        names = (
            f"stage {model.stage.name}"
            if not self.alone
            else (f"stages {', '.join(self.alone)}")
        )
        yield (
            f"{model.formulation}, {names}: fitted to {len(self.samples)} "
            f"samples, {self.objective_name} = {self.objective:.6g}"
        )
        yield (
            f"  (the annealing by itself reached {self.annealing_objective:.6g}; a local "
            "search finished it)"
        )
        for name, entry in self.parameters.to_mapping(self.standard_errors).items():
            yield (
                f"  {name:<14} {entry['value']:10.4g} +- "
                f"{entry['standard_error']:.2g} {entry['unit']}"
            )
        for stage, errors in self.alone.items():
            told = ", ".join(f"{error:.2g}" for error in errors.values())
            yield f"  (samples of {stage} alone would leave standard errors of {told})"
        yield (
            "  (leakage holds for a displacement of "
            f"{model.stage.pump_motor.motor_displacement:.4g} m3/rad, which is assumed)"
        )
        yield (
            f"  error of the fit         {100 * self.fit_error:6.2f} % "
            "(mean |predicted - measured| / measured)"
        )
        held_back = self.model.provenance.get("validation_samples")
        if self.prediction_error is not None:
            yield (
                f"  error of the prediction  {100 * self.prediction_error:6.2f} % "
                f"({held_back} samples held back)"
            )
        elif held_back is not None:
            yield (
                f"  error of the prediction  unknown: no answer at any of the {held_back} "
                "samples held back"
            )

    def _sample_lines(self, numbers: Sequence[int] | None) -> Iterator[str]:
        samples, tests = self.samples, self.samples.extra.get("test")
        names = tests or tuple(map(str, numbers or range(1, len(samples) + 1)))
        head = "test" if tests else "sample"
        yield f"  {head:>6}  displacement  engine      load    measured  predicted"
        yield "            ratio [-]  [rad/s]     [N m]         [-]        [-]"
        for i, measured in enumerate(samples.efficiency):
            yield (
                f"  {names[i]:>6}  {samples.displacement_ratio[i]:12.3f}  "
                f"{samples.engine_speed[i]:7.2f} {samples.load_torque[i]:9.2f}  "
                f"{measured:10.4f} {measured + self.residuals[i]:10.4f}"
            )
        doubled = sum(bool(entry.rejected) for entry in self.roots)
        if doubled:
            yield (
                f"  {doubled} samples have a second root for eta_H, beyond the pole of "
                "eq. (11); it was rejected"
            )


def identify(
    samples: BenchSamples,
    *,
    stage: Stage | Sequence[Stage] | None = None,
    formulation: str = "power_balance",
    gear_efficiency: float | None = None,
    effects: Sequence[Effect] = (),
    validation: BenchSamples | None = None,
    schedule: Schedule | None = None,
    seed: int | None = 0,
    progress: Callable[[AnnealingRun], None] | None = None,
) -> Identification:
    """Identify the three hydraulic parameters from bench samples by improved annealing.

    `power_balance` minimises the mean of weighted squares (weights from `efficiency_std`, else the
    paper's 1.12 %); `published` maximises RSQ, eq. (21), in the paper's two parts. The annealing
    finds the parameters, a local search gives them their last digits.

    Args:
        samples: at least one bench sample.
        stage: gear train; None for stage HM4 of the paper. Of several stages each sample names its
            own in column `stage`; pump and motor, and so the parameters, are the same in all.
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
    stages = [stage] if isinstance(stage, Stage) else list(stage)
    if gear_efficiency is not None:
        stages = [each.with_gear_efficiency(gear_efficiency) for each in stages]
    if len(stages) > 1 and (formulation == "published" or samples.points.stage is None):
        raise InputError(
            "several stages need formulation power_balance and samples with a column "
            f"stage; {samples.source} is to be fitted with "
            f"{', '.join(each.name for each in stages)}"
        )
    model = EfficiencyModel(
        stages[0],
        PAPER_PARAMETERS[0.98],
        formulation,
        tuple(effects),
        other_stages=tuple(stages[1:]),
    )
    problem = Problem(model, samples)
    parts = by_stage(model, samples)
    told = gear_train_remarks(model, samples)
    schedule = SCHEDULES[formulation] if schedule is None else schedule
    roots: list[HydraulicRoots] = []
    start = None
    if formulation == "published":
        roots = hydraulic_roots(model.stage, samples)
        # For half of the chains; the others begin at random.
        starts = starting_points(problem, roots)[: max(1, schedule.chains // 2)]
        low, high = SEARCH_BOUNDS.T
        fill = np.random.default_rng(seed).uniform(
            low, high, (schedule.chains, len(low))
        )
        start = np.concatenate([starts, fill])[: schedule.chains]
    annealed = annealing.minimise(
        replace(problem, samples=thinned(samples)).objective,
        SEARCH_BOUNDS,
        schedule=schedule,
        start=start,
        seed=seed,
        progress=progress,
    )
    scaled, value = problem.finish(annealed.ends[:_FINISHED])
    if not np.isfinite(value):
        raise IdentificationError(
            f"{samples.source}: no parameters within the bounds give an efficiency at every "
            f"sample: {'; '.join([*told, 'check stage, units and load torque'])}"
        )
    standard_errors, correlation = precision(problem, scaled)
    model = replace(
        model,
        parameters=HydraulicParameters(*problem.parameters(scaled).tolist()),
        standard_errors=standard_errors,
        correlation=correlation,
        domain=Domain.of(samples),
    )
    predicted = problem.predict(scaled)
    fit_error = mean_error(predicted, samples.efficiency)
    alone = (
        {}
        if len(parts) == 1
        else {
            name: precision(Problem(model, part), scaled, problem)[0]
            for name, part in parts.items()
        }
    )
    warnings = [*told, *findings(samples, model)]
    provenance: dict[str, Any] = {
        **origin("identify", samples, seed),
        "objective": OBJECTIVES[formulation],
        "objective_value": float(f"{value:.9g}"),
        "fit_error": float(f"{fit_error:.6g}"),
    }
    if validation is not None:
        held = Problem(model, validation)
        predicted_there = held.predict(scaled)
        if np.isfinite(predicted_there).any():
            error = mean_error(predicted_there, validation.efficiency)
            provenance["prediction_error"] = float(f"{error:.6g}")
        provenance["validation_samples"] = len(validation)
        if none := int(np.isnan(predicted_there).sum()):
            provenance["validation_without_answer"] = none
        warnings += unchecked(held, none, samples)
    return Identification(
        replace(model, provenance=provenance),
        samples,
        predicted - samples.efficiency,
        fit_error,
        provenance.get("prediction_error"),
        value,
        float(problem.objective(annealed.ends[0])),
        OBJECTIVES[formulation],
        (*annealed.history, value),
        annealed.evaluations,
        annealed.stop_reason,
        seed,
        tuple(warnings),
        tuple(roots),
        alone,
    )


def origin(command: str, samples: BenchSamples, seed: int | None) -> dict[str, Any]:
    """Say what made a model of which samples, and when, for its provenance."""
    return {
        "source": f"hmcvt {command}, version {__version__}",
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "data": Path(samples.source).name,
        "data_sha256": samples.sha256,
        "samples": len(samples),
        "seed": seed,
    }


def thinned(samples: BenchSamples) -> BenchSamples:
    """As many samples as the annealing looks at, spread over the displacement ratio."""
    if len(samples) <= _MOST_ANNEALED:
        return samples
    order = np.argsort(samples.displacement_ratio, kind="stable")
    return samples.select(
        order[np.linspace(0, len(order) - 1, _MOST_ANNEALED).astype(int)]
    )

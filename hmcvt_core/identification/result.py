# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outcome of an identification, as a model, as data and as text."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..files import picture, preformatted
from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..model.parameter_file import save_model
from ..transmission.parameters import (
    PARAMETER_NAMES,
    SEARCH_BOUNDS,
    HydraulicParameters,
    from_scaled,
)
from ..transmission.ranges import Array
from ..transmission.stage import CM3_PER_REV
from .criterion import CRITERIA
from .piecewise import HydraulicRoots


@dataclass(frozen=True, eq=False)
class Identification:
    """Outcome of an identification.

    Attributes:
        model: the identified model; carries errors, domain and provenance.
        samples: those it was fitted to, without the rejected ones.
        residuals: predicted - measured efficiency at them, shape (n,) [-].
        fit_error: mean |predicted - measured| / measured over them [-].
        prediction_error: the same over the samples held out at which the model has an answer, or
            None.
        objective: value reached of `objective_name`.
        annealing_objective: value that the annealing reached by itself, before the finish; NaN
            where some sample had no answer there.
        objective_name: what was minimised.
        history: best objective after each temperature step, then after the finish.
        evaluations: candidates evaluated by the annealing.
        stop_reason: of the annealing.
        seed: of the random numbers.
        warnings: plain sentences on what the samples leave open.
        roots: hydraulic efficiencies of part 1 by sample (`published` only).
        alone: standard errors that the samples of each stage would give by themselves, by stage
            and parameter; empty where all are of one.
        set_aside: samples that disagree with the rest, from 1 in the order given.
        contradictions: the first of `warnings`, on stages whose readings do not fit the gear train.
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
    set_aside: tuple[int, ...] = ()
    contradictions: tuple[str, ...] = ()

    @property
    def parameters(self) -> HydraulicParameters:
        """The identified parameters."""
        return self.model.parameters

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each parameter, in its unit."""
        return dict(self.model.standard_errors)

    @property
    def stages(self) -> list[str]:
        """Stages that the samples are of, in the order of the parameter file."""
        names = self.samples.points.stage
        if names is None:
            return [self.model.stage.name]
        return [name for name in self.model.stages if name in names]

    @property
    def correlation(self) -> Array:
        """Correlation of the parameters, shape (3, 3)."""
        return np.asarray(self.model.correlation)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the parameter file, whole or not at all."""
        save_model(self.model, path)

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome as plain data for JSON.

        `stage` is the first of `stages`, those that the samples are of.
        """
        efficiencies: set[float] = set()
        stages: dict[str, Any] = {}
        for name in self.stages:
            pairs = self.model.stages[name].stage.gear_pairs
            efficiencies |= {pair.efficiency for pair in pairs}
            errors = self.alone.get(name, self.standard_errors)
            stages[name] = {"standard_errors": dict(errors)}
        return {
            "formulation": self.model.formulation,
            "stage": self.stages[0],
            "stages": stages,
            "parameters": self.model.to_mapping()["parameters"],
            "correlation": self.correlation.tolist(),
            "degrees_of_freedom": self.model.degrees_of_freedom,
            "interval_90": {
                name: list(ends)
                for name, ends in self.model.parameter_intervals().items()
            },
            "misfit": self.model.misfit,
            "samples": len(self.samples),
            "fit_error": self.fit_error,
            "prediction_error": self.prediction_error,
            "objective": {"name": self.objective_name, "value": self.objective},
            "annealing_objective": self.annealing_objective,
            "evaluations": self.evaluations,
            "stop_reason": self.stop_reason,
            "seed": self.seed,
            "set_aside": list(self.set_aside),
            "residuals": self.residuals.tolist(),
            "warnings": list(self.warnings),
            "gear_efficiency": sorted(efficiencies),
        }

    def plot(self, holdout: BenchSamples | None = None, *, ax: Any = None) -> Any:
        """Draw measured over predicted efficiency.

        Args:
            holdout: samples held out, to draw too.
            ax: matplotlib axes to draw on; a new figure when left out.

        Returns:
            The matplotlib figure.
        """
        return picture(self, holdout, ax=ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())

    def report(self, numbers: Sequence[int] | None = None) -> str:
        """Return the outcome as text.

        Args:
            numbers: of the samples given, in their file; 1, 2, ... when left out.
        """
        # What questions the gear train questions all that follows.
        first = self.contradictions
        notes = [f"  note: {sentence}" for sentence in self.warnings[len(first) :]]
        return "\n".join(
            [*first, *self._result_lines(), *self._sample_lines(numbers), *notes]
        )

    def _result_lines(self) -> Iterator[str]:
        model = self.model
        noun = "stage" if len(self.stages) == 1 else "stages"
        yield (
            f"{model.formulation}, {noun} {', '.join(self.stages)}: fitted to {len(self.samples)} "
            f"samples, {self.objective_name} = {self.objective:.3g}"
        )
        yield f"  ({CRITERIA[model.formulation].meaning})"
        intervals = model.parameter_intervals()
        for name, entry in self.parameters.to_mapping(self.standard_errors).items():
            yield (
                f"  {name:<14} {entry['value']:10.4g} +- "
                f"{entry['standard_error']:.2g} {entry['unit']} "
                f"(90 %: {_interval_text(name, *intervals[name])})"
            )
        if model.degrees_of_freedom is not None:
            yield (
                "  (90 % intervals are those of Student's t with "
                f"{model.degrees_of_freedom:g} degrees of freedom)"
            )
        for stage in self.stages:
            if stage not in self.alone:
                continue
            spread = ", ".join(f"{error:.2g}" for error in self.alone[stage].values())
            yield f"  (samples of {stage} alone would leave standard errors of {spread})"
        displacement = model.stage.pump_motor.motor_displacement
        yield (
            "  (leakage holds for the motor displacement of the transmission file, "
            f"{displacement / CM3_PER_REV:.4g} cm3/rev)"
        )
        yield from self._error_lines()

    def _error_lines(self) -> Iterator[str]:
        if self.model.misfit > 0.0:
            yield (
                f"  form error               {100 * self.model.misfit:6.2f} points "
                "(root mean square of what the model misses at held-out samples)"
            )
        yield (
            f"  error of the fit         {100 * self.fit_error:6.2f} % "
            "(mean |predicted - measured| / measured)"
        )
        held_back = self.model.provenance.get("validation_samples")
        if self.prediction_error is not None:
            yield (
                f"  error of the prediction  {100 * self.prediction_error:6.2f} % "
                f"({held_back} samples held out)"
            )
        elif held_back is not None:
            yield (
                f"  error of the prediction  unknown: no answer at any of the {held_back} "
                "samples held out"
            )

    def _sample_lines(self, numbers: Sequence[int] | None) -> Iterator[str]:
        samples = self.samples
        given = numbers or range(1, len(samples) + len(self.set_aside) + 1)
        names: Sequence[object] = [
            number
            for position, number in enumerate(given, start=1)
            if position not in self.set_aside
        ]
        head = "sample"
        if "test" in samples.extra:
            names = samples.extra["test"]
            head = "test"
        stages = samples.stage
        heading = "" if stages is None else f"{'stage':>7}"
        below = " " * len(heading)
        yield (
            f"  {head:>6}{heading}  displacement  engine      load    measured  predicted"
        )
        yield f"        {below}    ratio [-]  [rad/s]     [N m]         [-]        [-]"
        for i, measured in enumerate(samples.efficiency):
            engaged = "" if stages is None else f"{stages[i]:>7}"
            yield (
                f"  {names[i]:>6}{engaged}  {samples.displacement_ratio[i]:12.3f}  "
                f"{samples.engine_speed[i]:7.2f} {samples.load_torque[i]:9.2f}  "
                f"{measured:10.4f} {measured + self.residuals[i]:10.4f}"
            )
        doubled = sum(bool(entry.rejected) for entry in self.roots)
        if doubled:
            yield (
                f"  {doubled} samples have a second root for eta_H, beyond the pole of "
                "eq. (11); it was rejected"
            )


def _interval_text(name: str, low: float, high: float) -> str:
    """Return the interval of a parameter, whose ends at the limits of the search say nothing.

    Args:
        name: of the parameter.
        low: end of the interval, in the unit of the parameter.
        high: end of the interval, in the unit of the parameter.
    """
    lowest, highest = from_scaled(SEARCH_BOUNDS.T)[:, PARAMETER_NAMES.index(name)]
    if low > lowest and high < highest:
        return f"{low:.3g} to {high:.3g}"
    if high < highest:
        return f"below {high:.3g}"
    if low > lowest:
        return f"above {low:.3g}"
    return "not determined"

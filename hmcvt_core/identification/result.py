# SPDX-License-Identifier: Apache-2.0
"""The outcome of an identification: its values, as text and as plain data."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..model.parameter_file import save_model
from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS, HydraulicParameters
from .two_part import HydraulicRoots

Array = NDArray[np.float64]


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
            "parameters": {
                name: {"value": getattr(self.parameters, name), "unit": PARAMETER_UNITS[name],
                       "standard_error": self.standard_errors[name]}
                for name in PARAMETER_NAMES
            },
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
            "gear_efficiency": sorted({pair.efficiency for pair in self.model.stage.gear_pairs}),
        }

    def report(self, numbers: Sequence[int] | None = None) -> str:
        """Return the outcome as text for a person.

        Args:
            numbers: of the samples in their file; 1, 2, ... when left out.
        """
        return "\n".join([*self._result_lines(), *self._sample_lines(numbers),
                          *(f"  note: {sentence}" for sentence in self.warnings)])

    def _result_lines(self) -> Iterator[str]:
        model = self.model
        yield (f"{model.formulation}, stage {model.stage.name}: fitted to {len(self.samples)} "
               f"samples, {self.objective_name} = {self.objective:.6g}")
        yield (f"  (the annealing by itself reached {self.annealing_objective:.6g}; a local "
               "search finished it)")
        for name in PARAMETER_NAMES:
            yield (f"  {name:<14} {getattr(self.parameters, name):10.4g} +- "
                   f"{self.standard_errors[name]:.2g} {PARAMETER_UNITS[name]}")
        yield ("  (leakage holds for a displacement of "
               f"{model.stage.pump_motor.motor_displacement:.4g} m3/rad, which is assumed)")
        yield (f"  error of the fit         {100 * self.fit_error:6.2f} % "
               "(mean |predicted - measured| / measured)")
        held_back = self.model.provenance.get("validation_samples")
        if self.prediction_error is not None:
            yield (f"  error of the prediction  {100 * self.prediction_error:6.2f} % "
                   f"({held_back} samples held back)")
        elif held_back is not None:
            yield (f"  error of the prediction  unknown: no answer at any of the {held_back} "
                   "samples held back")

    def _sample_lines(self, numbers: Sequence[int] | None) -> Iterator[str]:
        samples, tests = self.samples, self.samples.extra.get("test")
        names = tests or tuple(map(str, numbers or range(1, len(samples) + 1)))
        head = "test" if tests else "sample"
        yield f"  {head:>6}  displacement  engine      load    measured  predicted"
        yield "            ratio [-]  [rad/s]     [N m]         [-]        [-]"
        for i, measured in enumerate(samples.efficiency):
            yield (f"  {names[i]:>6}  {samples.displacement_ratio[i]:12.3f}  "
                   f"{samples.engine_speed[i]:7.2f} {samples.load_torque[i]:9.2f}  "
                   f"{measured:10.4f} {measured + self.residuals[i]:10.4f}")
        doubled = sum(bool(entry.rejected) for entry in self.roots)
        if doubled:
            yield (f"  {doubled} samples have a second root for eta_H, beyond the pole of "
                   "eq. (11); it was rejected")

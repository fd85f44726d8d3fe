# SPDX-License-Identifier: Apache-2.0
"""An identification as text and as plain data; nothing is computed here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..transmission.parameters import PARAMETER_NAMES, PARAMETER_UNITS

if TYPE_CHECKING:
    from .identify import Identification


def report(found: Identification, numbers: Sequence[int] | None = None) -> str:
    """Return an identification as text for a person; see `Identification.report`."""
    model, samples = found.model, found.samples
    units = model.stage.pump_motor
    lines = [f"{model.formulation}, stage {model.stage.name}: fitted to {len(samples)} samples, "
             f"{found.objective_name} = {found.objective:.6g}"]
    for name in PARAMETER_NAMES:
        value, error = getattr(model.parameters, name), found.standard_errors[name]
        lines.append(f"  {name:<14} {value:10.4g} +- {error:.2g} {PARAMETER_UNITS[name]}")
    lines.append(f"  (leakage holds for a displacement of {units.motor_displacement:.4g} m3/rad, "
                 "which is assumed)")
    lines.append(f"  error of the fit         {100 * found.fit_error:6.2f} % "
                 "(mean |predicted - measured| / measured)")
    if found.prediction_error is not None:
        lines.append(f"  error of the prediction  {100 * found.prediction_error:6.2f} % "
                     f"({model.provenance['validation_samples']} samples held back)")
    elif "validation_samples" in model.provenance:
        lines.append(f"  error of the prediction  unknown: no answer at any of the "
                     f"{model.provenance['validation_samples']} samples held back")
    tests = samples.extra.get("test")
    names = tests or tuple(map(str, numbers or range(1, len(samples) + 1)))
    head = "test" if tests else "sample"
    lines.append(f"  {head:>6}  displacement  engine      load    measured  predicted")
    lines.append("            ratio [-]  [rad/s]     [N m]         [-]        [-]")
    for i in range(len(samples)):
        measured = samples.efficiency[i]
        lines.append(
            f"  {names[i]:>6}  {samples.displacement_ratio[i]:12.3f}  "
            f"{samples.engine_speed[i]:7.2f} {samples.load_torque[i]:9.2f}  "
            f"{measured:10.4f} {measured + found.residuals[i]:10.4f}")
    doubled = sum(1 for entry in found.roots if entry.rejected)
    if doubled:
        lines.append(f"  {doubled} samples have a second root for eta_H, beyond the pole of "
                     "eq. (11); it was rejected")
    lines += [f"  note: {sentence}" for sentence in found.warnings]
    return "\n".join(lines)


def to_dict(found: Identification) -> dict[str, Any]:
    """Return an identification as plain data for JSON."""
    model = found.model
    return {
        "formulation": model.formulation,
        "stage": model.stage.name,
        "parameters": {
            name: {"value": getattr(model.parameters, name), "unit": PARAMETER_UNITS[name],
                   "standard_error": found.standard_errors[name]}
            for name in PARAMETER_NAMES
        },
        "correlation": found.correlation.tolist(),
        "samples": len(found.samples),
        "fit_error": found.fit_error,
        "prediction_error": found.prediction_error,
        "objective": {"name": found.objective_name, "value": found.objective},
        "evaluations": found.evaluations,
        "stop_reason": found.stop_reason,
        "seed": found.seed,
        "residuals": found.residuals.tolist(),
        "warnings": list(found.warnings),
    }

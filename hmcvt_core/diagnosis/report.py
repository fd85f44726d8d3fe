# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as plain data and as text; nothing is computed here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .result import Cause, Diagnosis


def to_dict(found: Diagnosis) -> dict[str, Any]:
    """Return the JSON object of the command's contract."""
    gap, shrunk = found.gap, found.shrinkage
    return {
        "gap": {"samples": gap.samples, "rmse": gap.rmse, "noise": gap.noise,
                "noise_stated": gap.noise_stated, "noise_source": gap.noise_source,
                "p_value": gap.p_value, "significant": gap.significant},
        "where": [{
            "displacement_ratio": list(region.displacement_ratio),
            "engine_speed": list(region.engine_speed),
            "load_torque": list(region.load_torque),
            "mean_residual": region.mean_residual, "samples": region.samples,
            "p_value": region.p_value} for region in found.where],
        "component": found.component,
        "verdict": found.verdict,
        "causes": [_cause(cause) for cause in found.causes],
        "unlisted_probability": found.unlisted,
        "shrinkage": {"before": shrunk.before, "after": shrunk.after,
                      "fraction": shrunk.fraction,
                      "interval": None if shrunk.interval is None else list(shrunk.interval),
                      "on": shrunk.on},
        "next_tests": [{
            "displacement_ratio": test.displacement_ratio, "engine_speed": test.engine_speed,
            "load_torque": test.load_torque, "separates": list(test.separates),
            "gain": test.gain, "measure": test.measure} for test in found.next_tests],
        "notes": list(found.notes),
    }


def _cause(cause: Cause) -> dict[str, Any]:
    return {
        "effect": cause.effect,
        "form": cause.form,
        "component": cause.component,
        "probability": cause.probability,
        "indistinguishable_from": list(cause.indistinguishable_from),
        "together_with": cause.together_with,
        "parameters": cause.parameters,
        "gap_after": cause.gap_after,
        "shrinkage": cause.shrinkage,
        "drift": cause.drift,
        "summary": cause.summary,
        "source": cause.source,
        "remedy": cause.remedy,
    }


def report(found: Diagnosis) -> str:
    """Return a diagnosis as text for a person."""
    return str(to_dict(found))

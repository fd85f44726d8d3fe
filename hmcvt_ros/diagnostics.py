# SPDX-License-Identifier: Apache-2.0
"""The two statuses of the node on /diagnostics: its inputs and its model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from .inputs import Inputs, OperatingPoint, State, Tally
from .model_store import InService

_LEVELS = {
    State.FRESH: DiagnosticStatus.OK,
    State.MISSING: DiagnosticStatus.WARN,
    State.STALE: DiagnosticStatus.STALE,
    State.INVALID: DiagnosticStatus.ERROR,
}
NOT_WRITTEN = "not written"
BENCH_REASONS = ("invalid", "log full", NOT_WRITTEN)
"""Why a bench sample may be refused."""


def gap_values(found: Mapping[str, Any], model: str, time: str) -> dict[str, str]:
    """Return what is shown of an answer of `~/diagnose` about the model with a fingerprint."""
    causes, fraction = found["causes"], found["shrinkage"]["fraction"]
    return {
        "gap verdict": found["verdict"],
        "gap leading cause": f"{causes[0]['effect']}, probability {causes[0]['probability']:.2f}"
                             if causes else "-",
        "gap rmse [-]": f"{found['gap']['rmse']:.4g}",
        "gap shrinkage [-]": "-" if fraction is None else f"{fraction:.3f}",
        "gap diagnosed": f"{time}, {found['gap']['samples']} samples",
        "gap of model": model,
        "report": found["report"] or "-",
    }


@dataclass
class Activity:
    """What the node has done so far.

    Attributes:
        bench: the bench samples.
        last_refit: how the last refit ended.
        last_diagnosis: how the last diagnosis ended.
        gap: `gap_values` of the last one that succeeded; empty before.
        running: the background job, empty when there is none.
    """

    bench: Tally = field(default_factory=lambda: Tally(BENCH_REASONS))
    last_refit: str = "none"
    last_diagnosis: str = "none"
    gap: Mapping[str, str] = field(default_factory=dict)
    running: str = ""


def inputs_status(
    name: str, inputs: Inputs, now: int, timeouts: Mapping[str, float], answered: int
) -> DiagnosticStatus:
    """Return the status of the inputs: the worst state of the three, each with age and counts."""
    values: dict[str, Any] = {}
    found = []
    for key, item in inputs.by_name.items():
        age, limit = item.age(now), timeouts[key]
        found.append(item.state(now, limit))
        values |= {f"{key} state": found[-1][0].value,
                   f"{key} age [s]": "-" if age is None else f"{age:.3f}",
                   f"{key} age limit [s]": f"{limit:g}", **item.tally.values(key)}
    values |= {"points answered": answered, "clock jumps": inputs.clock_jumps}
    worst = max((state for state, _ in found), key=list(State).index)
    message = "; ".join(problem for _, problem in found if problem) or "three fresh inputs"
    return _status(name, "inputs", _LEVELS[worst], message, values)


def model_status(
    name: str,
    now: InService,
    activity: Activity,
    logged: int,
    point: OperatingPoint | None,
    refusal: str,
) -> DiagnosticStatus:
    """Return the status of the model: which one, how good, and whether it covers the point now.

    Args:
        name: of the node.
        now: the model in service.
        activity: of the node.
        logged: samples in the bench log.
        point: the operating point now, None without one.
        refusal: why the model has no answer there; empty when it has.
    """
    domain = now.model.domain
    outside = [] if point is None or domain is None else domain.departures(*point)
    extrapolation = "extrapolation: " + "; ".join(outside) if outside else ""
    complaints = [refusal if point is not None else "", extrapolation, activity.bench.complaint]
    message = "; ".join(filter(None, complaints)) or f"serving {now.path}"
    level = (DiagnosticStatus.ERROR if activity.bench.reason == NOT_WRITTEN  # data is being lost
             else DiagnosticStatus.WARN if any(complaints) else DiagnosticStatus.OK)
    model = now.model
    values = {
        "file": now.path,
        "fingerprint": model.fingerprint,
        "formulation": model.formulation,
        "source": model.provenance.get("source", "-"),
        "identified": model.provenance.get("date", "-"),
        "fit error [-]": model.provenance.get("fit_error", "-"),
        "in service since": now.since,
        "extrapolation": "; ".join(outside) or "no",
        "bench samples logged": logged,
        **activity.bench.values("bench samples"),
        "last refit": activity.last_refit,
        "last diagnosis": activity.last_diagnosis,
        **activity.gap,
        "running": activity.running or "-",
    }
    return _status(name, "model", level, message, values)


def _status(
    node: str, part: str, level: bytes, message: str, values: Mapping[str, Any]
) -> DiagnosticStatus:
    return DiagnosticStatus(
        name=f"{node}: {part}", hardware_id=node, level=level, message=message,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])

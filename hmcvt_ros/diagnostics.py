# SPDX-License-Identifier: Apache-2.0
"""The two statuses of the node on /diagnostics: its inputs and its model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from .inputs import REASONS, Inputs, OperatingPoint, State
from .model_store import InService

_LEVELS = {
    State.FRESH: DiagnosticStatus.OK,
    State.MISSING: DiagnosticStatus.WARN,
    State.STALE: DiagnosticStatus.STALE,
    State.INVALID: DiagnosticStatus.ERROR,
}
_WORST_LAST = (State.FRESH, State.MISSING, State.STALE, State.INVALID)
NOT_WRITTEN = "not written"
BENCH_REASONS = ("invalid", "log full", NOT_WRITTEN)
"""Why a bench sample may be refused."""


@dataclass
class BenchCounts:
    """What became of the bench samples received.

    Attributes:
        received: all that were accepted or refused.
        accepted: written to the log.
        refused: by `BENCH_REASONS`.
        reason: why the last one was refused; empty when it was not.
        complaint: the same for a person.
    """

    received: int = 0
    accepted: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    reason: str = ""
    complaint: str = ""

    def accept(self) -> None:
        """Count one that is in the log."""
        self.accepted += 1
        self.reason = self.complaint = ""

    def refuse(self, reason: str, complaint: str) -> None:
        """Count one that is not."""
        self.refused[reason] += 1
        self.reason, self.complaint = reason, complaint

    def cannot_write(self, complaint: str) -> None:
        """Say so before the first sample is lost; the first that is written proves it wrong."""
        self.reason, self.complaint = NOT_WRITTEN, complaint


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

    bench: BenchCounts = field(default_factory=BenchCounts)
    last_refit: str = "none"
    last_diagnosis: str = "none"
    gap: Mapping[str, str] = field(default_factory=dict)
    running: str = ""


def inputs_status(
    name: str, inputs: Inputs, now: int, timeouts: Mapping[str, float], answered: int
) -> DiagnosticStatus:
    """Return the status of the inputs: the worst state of the three, each with age and counts."""
    states = {key: item.state(now, timeouts[key]) for key, item in inputs.by_name.items()}
    worst = max(states.values(), key=_WORST_LAST.index)
    values: dict[str, Any] = {}
    for key, item in inputs.by_name.items():
        age = item.age(now)
        values[f"{key} state"] = states[key].value
        values[f"{key} age [s]"] = "-" if age is None else f"{age:.3f}"
        values[f"{key} age limit [s]"] = f"{timeouts[key]:g}"
        values[f"{key} received"] = item.received
        values[f"{key} accepted"] = item.accepted
        for reason in REASONS:
            values[f"{key} refused, {reason}"] = item.refused[reason]
    values["points answered"] = answered
    values["clock jumps"] = inputs.clock_jumps
    message = "; ".join(inputs.problems(now, timeouts)) or "three fresh inputs"
    return _status(f"{name}: inputs", name, _LEVELS[worst], message, values)


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
    outside = [] if point is None or domain is None else domain.departures(
        point.displacement_ratio, point.engine_speed, point.load_torque)
    extrapolation = "extrapolation: " + "; ".join(outside) if outside else ""
    complaints = [refusal if point is not None else "", extrapolation, activity.bench.complaint]
    message = "; ".join(filter(None, complaints)) or f"serving {now.path}"
    if activity.bench.reason == NOT_WRITTEN:
        level = DiagnosticStatus.ERROR  # data is being lost
    else:
        level = DiagnosticStatus.WARN if any(complaints) else DiagnosticStatus.OK
    model, bench = now.model, activity.bench
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
        "bench samples received": bench.received,
        "bench samples accepted": bench.accepted,
        **{f"bench samples refused, {reason}": bench.refused[reason] for reason in BENCH_REASONS},
        "last refit": activity.last_refit,
        "last diagnosis": activity.last_diagnosis,
        **activity.gap,
        "running": activity.running or "-",
    }
    return _status(f"{name}: model", name, level, message, values)


def _status(
    name: str, hardware: str, level: bytes, message: str, values: Mapping[str, Any]
) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        name=name, hardware_id=hardware, level=level, message=message, values=pairs)

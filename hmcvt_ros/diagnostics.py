# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The three statuses of the node on /diagnostics: its inputs, its model and the gap."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from hmcvt_core import Opening

from .bench_log import NOT_WRITTEN, Recorder
from .inputs import NANOSECONDS, Inputs, OperatingPoint, State
from .model_store import InService
from .parameters import Settings

_LEVELS = {
    State.FRESH: DiagnosticStatus.OK,
    State.COASTING: DiagnosticStatus.OK,
    State.MISSING: DiagnosticStatus.WARN,
    State.STALE: DiagnosticStatus.STALE,
    State.INVALID: DiagnosticStatus.ERROR,
}


def gap_values(found: Mapping[str, Any], model: str, when: str) -> dict[str, str]:
    """Return what is shown of an answer of `~/diagnose` about the model with a fingerprint."""
    causes, fraction = found["causes"], found["shrinkage"]["fraction"]
    return {
        "gap verdict": found["verdict"],
        "gap leading cause": f"{causes[0]['effect']}, probability {causes[0]['probability']:.2f}"
        if causes
        else "-",
        "gap rmse [-]": f"{found['gap']['rmse']:.4g}",
        "gap shrinkage [-]": "-" if fraction is None else f"{fraction:.3f}",
        "gap diagnosed": f"{when}, {found['gap']['samples']} samples",
        "gap of model": model,
        "report": found["report"] or "-",
    }


@dataclass
class Job:
    """What is under way for a caller of a service; one at a time.

    Attributes:
        name: of the service.
        started: when, by the monotonic clock [s].
        working: whether the worker does it; else it waits for a disk.
        stopped: whether the worker was found stopped.
        ended: why before its end; empty when it was not.
    """

    name: str
    started: float = field(default_factory=time.monotonic)
    working: bool = False
    stopped: bool = False
    ended: str = ""

    @property
    def seconds(self) -> float:
        """How long it has been under way."""
        return time.monotonic() - self.started

    def __str__(self) -> str:
        return f"{self.name} has been running for {self.seconds:.1f} s"


class Staged(NamedTuple):
    """A refit that waits for `~/adopt`: its file, and what it is to take the place of."""

    path: Path
    fingerprint: str
    instead_of: Path

    def __str__(self) -> str:
        return f"{self.path} ({self.fingerprint})"


@dataclass
class Activity:
    """What the node has done so far and does now.

    Attributes:
        ends: how the last refit and the last diagnosis ended, by service.
        gap: `gap_values` of the last diagnosis that succeeded; empty before.
        job: under way, if any.
        trouble: why the last job did not come to its end; empty when it did, or was cancelled.
        staged: the refit staged last, until the model in service or the log is another.
    """

    ends: dict[str, str] = field(
        default_factory=lambda: {"reidentify": "none", "diagnose": "none"}
    )
    gap: Mapping[str, str] = field(default_factory=dict)
    job: Job | None = None
    trouble: str = ""
    staged: Staged | None = None


def inputs_status(
    name: str, inputs: Inputs, now: int, settings: Settings, counts: Mapping[str, int]
) -> DiagnosticStatus:
    """Return the status of the inputs: the worst of the three and the last operating point."""
    values: dict[str, Any] = {}
    found = []
    for (key, item), limit in zip(
        inputs.by_name.items(), settings.age_limits.ages, strict=True
    ):
        age = item.age(now)
        found.append(item.state(now, limit))
        values |= {
            f"{key} state": found[-1][0].value,
            f"{key} age [s]": "-" if age is None else f"{age:.3f}",
            f"{key} age limit [s]": f"{limit * NANOSECONDS:g}",
            **item.tally.values(key),
        }
    if inputs.asked:
        if all(item.stamp is None for item in inputs.by_name.values()):
            found = []  # whoever sends operating points alone lacks nothing
        found.append(inputs.asked)
    level = _LEVELS[max((state for state, _ in found), key=list(State).index)]
    problems = [problem for _, problem in found if problem]
    if inputs.apart_reason:
        problems.append(inputs.apart_reason)
        level = max(level, DiagnosticStatus.WARN)
    message = "; ".join(problems) or (
        "three fresh inputs" if found[2:] else "operating points"
    )
    return _status(name, "inputs", level, message, {**values, **counts})


def model_status(
    name: str,
    now: InService,
    complaint: str,
    activity: Activity,
    log: Recorder,
    point: OperatingPoint | None,
    refusal: str,
) -> DiagnosticStatus:
    """Return the status of the model: which one, how good, and whether it covers the point now.

    Args:
        name: of the node.
        now: the model in service.
        complaint: why another than the last one adopted serves; empty when that does.
        activity: of the node.
        log: of the bench samples.
        point: the operating point now, None without one.
        refusal: why the model has no answer there; empty when it has.
    """
    domain = now.model.domain
    outside = [] if point is None or domain is None else domain.departures(*point)
    extrapolation = "extrapolation: " + "; ".join(outside) if outside else ""
    state = "; ".join(filter(None, (complaint, log.complaint)))
    warnings = _refit_warnings(now)
    complaints = [
        refusal if point is not None else "",
        extrapolation,
        log.tally.complaint,
        state,
        activity.trouble,
        warnings,
    ]
    message = "; ".join(filter(None, complaints)) or f"serving {now.path}"
    level = (
        DiagnosticStatus.ERROR
        if log.tally.reason == NOT_WRITTEN  # data is being lost
        else DiagnosticStatus.WARN
        if any(complaints)
        else DiagnosticStatus.OK
    )
    model = now.model
    values = {
        "file": now.path,
        "fingerprint": model.fingerprint,
        "formulation": model.formulation,
        "source": model.provenance.get("source", "-"),
        "identified": model.provenance.get("date", "-"),
        "fit error [-]": model.provenance.get("fit_error", "-"),
        "drift [-]": model.provenance.get("drift", "-"),
        "refit warnings": warnings or "none",
        "in service since": now.since,
        "extrapolation": "; ".join(outside) or "no",
        "state folder": state or "intact",
        "bench samples logged": len(log.log),
        **log.tally.values("bench samples"),
        "bench samples lost": log.numbers.missing,
        "last refit": activity.ends["reidentify"],
        "staged refit": activity.staged or "-",
        "last diagnosis": activity.ends["diagnose"],
        **activity.gap,
        "running": activity.job if activity.job and activity.job.working else "-",
    }
    return _status(name, "model", level, message, values)


def gap_status(name: str, found: Opening) -> DiagnosticStatus:
    """Return the status of the gap between the bench samples that came and the model in service."""
    level = DiagnosticStatus.WARN if found.open else DiagnosticStatus.OK
    return _status(
        name,
        "gap",
        level,
        str(found),
        {key.replace("_", " "): _shown(value) for key, value in found.to_dict().items()},
    )


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return " to ".join(map(_shown, value))
    return (
        "-"
        if value is None
        else f"{value:.6g}"
        if isinstance(value, float)
        else str(value)
    )


def _refit_warnings(now: InService) -> str:
    found = now.model.provenance.get("warnings", [])
    return "; ".join(map(str, found)) if isinstance(found, list) else str(found)


def _status(
    node: str, part: str, level: bytes, message: str, values: Mapping[str, Any]
) -> DiagnosticStatus:
    return DiagnosticStatus(
        name=f"{node}: {part}",
        hardware_id=node,
        level=level,
        message=message,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )

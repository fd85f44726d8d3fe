# SPDX-License-Identifier: Apache-2.0
"""The two statuses of the node on /diagnostics: its inputs and its model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from .inputs import Inputs, OperatingPoint, State
from .model_store import ModelStore

_LEVELS = {
    State.FRESH: DiagnosticStatus.OK,
    State.MISSING: DiagnosticStatus.WARN,
    State.STALE: DiagnosticStatus.STALE,
    State.INVALID: DiagnosticStatus.ERROR,
}
_WORST_LAST = (State.FRESH, State.MISSING, State.STALE, State.INVALID)


@dataclass
class Activity:
    """What the node has done so far.

    Attributes:
        outputs: count of points answered.
        refusal: why the last operating point has no answer; empty when it has.
        bench_refused: counts of bench samples by reason.
        bench_complaint: about the last bench sample; empty when it was logged.
        last_refit: how the last refit ended.
        running: the background job, empty when there is none.
    """

    outputs: int = 0
    refusal: str = ""
    bench_refused: Counter[str] = field(default_factory=Counter)
    bench_complaint: str = ""
    last_refit: str = "none"
    running: str = ""


def inputs_status(
    name: str, inputs: Inputs, activity: Activity, now: int, timeout: float
) -> DiagnosticStatus:
    """Return the status of the inputs: the worst state of the three, each with age and counts."""
    states = {item.limits.name: item.state(now, timeout) for item in inputs.by_name.values()}
    worst = max(states.values(), key=_WORST_LAST.index)
    problems = inputs.problems(now, timeout)
    values: dict[str, Any] = {}
    for key, item in inputs.by_name.items():
        age = item.age(now)
        values[f"{key} state"] = states[key].value
        values[f"{key} age [s]"] = "-" if age is None else f"{age:.3f}"
        values[f"{key} accepted"] = item.accepted
        for reason in ("not finite", "out of range"):
            values[f"{key} refused, {reason}"] = item.refused[reason]
    values["points answered"] = activity.outputs
    message = "; ".join(problems) or "three fresh inputs"
    return _status(f"{name}: inputs", name, _LEVELS[worst], message, values)


def model_status(
    name: str, store: ModelStore, activity: Activity, samples: int, point: OperatingPoint | None
) -> DiagnosticStatus:
    """Return the status of the model: which one, how good, and whether it covers the point now."""
    model = store.model
    warnings = [activity.refusal] if point is not None and activity.refusal else []
    if point is not None and model.domain is not None and not model.predict(*point).inside_domain:
        warnings.append("extrapolation: the operating point lies outside the identification data")
    if activity.bench_complaint:
        warnings.append(activity.bench_complaint)
    values = {
        "file": store.path,
        "fingerprint": model.fingerprint,
        "formulation": model.formulation,
        "source": model.provenance.get("source", "-"),
        "identified": model.provenance.get("date", "-"),
        "fit error [-]": model.provenance.get("fit_error", "-"),
        "in service since": store.since,
        "bench samples logged": samples,
        **{f"bench samples refused, {why}": n for why, n in activity.bench_refused.items()},
        "last refit": activity.last_refit,
        "running": activity.running or "-",
    }
    level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
    message = "; ".join(warnings) or f"serving {store.path}"
    return _status(f"{name}: model", name, level, message, values)


def _status(
    name: str, hardware: str, level: bytes, message: str, values: Mapping[str, Any]
) -> DiagnosticStatus:
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        name=name, hardware_id=hardware, level=level, message=message, values=pairs)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The three statuses of the node on /diagnostics: its inputs, its model and the gap."""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from hmcvt_core import Opening

from .inputs import INPUT_RANGES, NANOSECONDS, Inputs, OperatingPoint, State
from .model_store import InService
from .parameters import Settings, changes
from .public_text import PublicText
from .recorder import NOT_WRITTEN, Recorder

LEVELS = {
    State.FRESH: DiagnosticStatus.OK,
    State.COASTING: DiagnosticStatus.OK,
    State.MISSING: DiagnosticStatus.WARN,
    # Also on a machine that is parked; the level STALE is for an aggregator that misses the node.
    State.STALE: DiagnosticStatus.WARN,
    State.INVALID: DiagnosticStatus.ERROR,
}
"""Level of `inputs` by the state of an input."""
_FROM_GOOD_TO_BAD = list(State)
_NOTHING = "-"

_EACH_INPUT = ("state", "age [s]")
ALWAYS = {
    "inputs": (
        *(f"{limits.name} {word}" for limits in INPUT_RANGES for word in _EACH_INPUT),
        "points answered",
    ),
    "model": (
        "file",
        "fingerprint",
        "bench samples logged",
        "last refit",
        "staged refit",
        "last diagnosis",
        "running",
    ),
    "gap": ("samples", "open"),
}
"""Keys that every message has, by the status."""
ALL_EVERY = 60.0
"""Time between two messages with all keys, for those that missed one [s]; chosen by us."""
NEW_LISTENER = 5.0
"""Time for which all messages have all keys when somebody begins to listen [s]; chosen by us."""


class ChangeFilter:
    """Leaves out of the statuses what the last message had already.

    A status has the keys of `ALWAYS` and those whose values have changed since the last message. It
    has all keys while its level is not OK, for `NEW_LISTENER` after somebody begins to listen, and
    once in `ALL_EVERY`.
    """

    def __init__(self) -> None:
        self._known: dict[str, dict[str, str]] = {}
        self._listeners = 0
        self._all_until = -math.inf
        self._all_next = -math.inf

    def reduce(
        self, statuses: Iterable[DiagnosticStatus], now: float, listeners: int
    ) -> list[DiagnosticStatus]:
        """Return statuses without what their last message had already.

        Args:
            statuses: statuses with all keys.
            now: time by a steady clock [s].
            listeners: count of the subscribers.
        """
        if listeners > self._listeners:
            self._all_until = now + NEW_LISTENER
        self._listeners = listeners
        complete = now <= self._all_until or now >= self._all_next
        if complete:
            self._all_next = now + ALL_EVERY
        reduced = []
        for status in statuses:
            part = status.name.rpartition(": ")[2]
            known = self._known.get(part, {})
            self._known[part] = {pair.key: pair.value for pair in status.values}
            if not complete and status.level == DiagnosticStatus.OK:
                status.values = [
                    pair
                    for pair in status.values
                    if pair.key in ALWAYS[part] or pair.value != known.get(pair.key)
                ]
            reduced.append(status)
        return reduced


@dataclass
class Job:
    """A job under way for a caller of a service; one at a time.

    Attributes:
        name: name of the service.
        started: start by the monotonic clock [s].
        working: whether the worker does it; otherwise it waits for a disk.
        computed: whether the worker has done it, and its result is taken up.
        stopped: whether the worker was found stopped.
        starved: whether the worker got hardly any time on the processors and was begun again.
        ended: why it was ended early; empty when it was not.
    """

    name: str
    started: float = field(default_factory=time.monotonic)
    working: bool = False
    computed: bool = False
    stopped: bool = False
    starved: bool = False
    ended: str = ""

    @property
    def seconds(self) -> float:
        """How long it has been under way."""
        return time.monotonic() - self.started

    def __str__(self) -> str:
        return f"{self.name} has been running for {self.seconds:.1f} s"


class Staged(NamedTuple):
    """A refit that waits for `~/adopt`.

    Attributes:
        path: its file.
        fingerprint: its fingerprint.
        instead_of: file that it is to replace.
        reason: why it waits.
    """

    path: Path
    fingerprint: str
    instead_of: Path
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.path} ({self.fingerprint}): {self.reason}"


@dataclass
class Activity:
    """What the node has done and does.

    Attributes:
        ends: how the last refit and the last diagnosis ended, by service.
        gap: `gap_values` of the last diagnosis that succeeded; empty before.
        job: job under way, if any.
        trouble: why the last job was ended early; empty when it was not, or was cancelled.
        staged: refit staged last, until the model in service or the log is another.
        sample_stage: stage of the last bench sample and where it comes from; empty before.
    """

    ends: dict[str, str] = field(
        default_factory=lambda: {"reidentify": "none", "diagnose": "none"}
    )
    gap: Mapping[str, str] = field(default_factory=dict)
    job: Job | None = None
    trouble: str = ""
    staged: Staged | None = None
    sample_stage: str = ""


def gap_values(answer: Mapping[str, Any], model: str, when: str) -> dict[str, str]:
    """Return the values that diagnostics show of an answer of `~/diagnose`.

    Args:
        answer: object of the answer.
        model: fingerprint of the model that was diagnosed.
        when: time of the diagnosis.
    """
    leading = _NOTHING
    if answer["causes"]:
        cause = answer["causes"][0]
        leading = f"{cause['effect']}, probability {cause['probability']:.2f}"
    shrinkage = _NOTHING
    if answer["shrinkage"]["fraction"] is not None:
        shrinkage = f"{answer['shrinkage']['fraction']:.3f}"
    return {
        "gap verdict": answer["verdict"],
        "gap leading cause": leading,
        "gap rmse [-]": f"{answer['gap']['rmse']:.4g}",
        "gap shrinkage [-]": shrinkage,
        "gap diagnosed": f"{when}, {answer['gap']['samples']} samples",
        "gap of model": model,
        "report": answer["report"] or _NOTHING,
    }


def inputs_status(
    name: str,
    public: PublicText,
    inputs: Inputs,
    now: int,
    settings: Settings,
    counts: Mapping[str, Any],
    warnings: Sequence[str] = (),
) -> DiagnosticStatus:
    """Return the status of the inputs: the worst of the three and the last operating point.

    Args:
        name: name of the node.
        public: what of a text may leave the machine.
        inputs: the three inputs.
        now: time by the clock of the ages [ns].
        settings: parameters of the node.
        counts: counts of what was answered and refused, and the oil temperature.
        warnings: complaints that make the level at least WARN.
    """
    values: dict[str, Any] = {}
    states = []
    limits = settings.age_limits.ages
    for (key, item), limit in zip(inputs.by_name.items(), limits, strict=True):
        age = item.age(now)
        state, message = item.state(now, limit)
        states.append((state, message))
        values[f"{key} state"] = state.value
        values[f"{key} age [s]"] = _NOTHING if age is None else f"{age:.3f}"
        values[f"{key} age limit [s]"] = f"{limit * NANOSECONDS:g}"
        values.update(item.tally.values(key))
        values[f"{key} lost"] = item.numbers.missing
    text = "three fresh inputs"
    if inputs.asked:
        if all(item.stamp is None for item in inputs.by_name.values()):
            # A client that sends operating points alone lacks nothing.
            states = []
            text = "operating points"
        states.append(inputs.asked)
    worst = max((state for state, _ in states), key=_FROM_GOOD_TO_BAD.index)
    level = LEVELS[worst]
    problems = [message for _, message in states if message]
    if warnings:
        problems.extend(warnings)
        level = max(level, DiagnosticStatus.WARN)
    message = "; ".join(problems) or text
    return _status(name, "inputs", level, message, {**values, **counts}, public)


def model_status(
    name: str,
    public: PublicText,
    served: InService,
    complaint: str,
    activity: Activity,
    log: Recorder,
    point: OperatingPoint | None,
    oil_temperature: float | None,
    refusal: str,
    start: Settings,
    settings: Settings,
) -> DiagnosticStatus:
    """Return the status of the model: which one, how good, and whether it covers the point.

    Args:
        name: name of the node.
        public: what of a text may leave the machine.
        served: model in service.
        complaint: why it is not the last model put into service; empty when it is.
        activity: what the node has done and does.
        log: log of the bench samples.
        point: present operating point, None without one.
        oil_temperature: [deg C]; None where it is not known, or does not matter.
        refusal: why the model has no answer there; empty when it has.
        start: parameters of the node at its start.
        settings: present parameters.
    """
    extrapolation = _extrapolation(served, point, oil_temperature)
    changed = changes(start, settings)
    state = "; ".join(filter(None, (complaint, log.complaint)))
    warnings = _refit_warnings(served)
    complaints = [
        refusal if point is not None else "",
        f"extrapolation: {extrapolation}" if extrapolation else "",
        log.tally.complaint,
        state,
        activity.trouble,
        warnings,
    ]
    level = DiagnosticStatus.OK
    if any(complaints):
        level = DiagnosticStatus.WARN
    if log.tally.reason == NOT_WRITTEN:  # data is being lost
        level = DiagnosticStatus.ERROR
    provenance = served.model.provenance
    values = {
        "file": served.path,
        "fingerprint": served.model.fingerprint,
        "formulation": served.model.formulation,
        "source": provenance.get("source", _NOTHING),
        "identified": provenance.get("date", _NOTHING),
        "fit error [-]": provenance.get("fit_error", _NOTHING),
        "drift [-]": provenance.get("drift", _NOTHING),
        "refit warnings": warnings or "none",
        "in service since": served.since,
        "extrapolation": extrapolation or "no",
        "state folder": state or "intact",
        "bench samples logged": len(log.log),
        **log.tally.values("bench samples"),
        "bench samples repeated": log.repeats,
        "bench samples lost": log.numbers.missing,
        "limits changed": changes(start, settings, limits_only=True) or "none",
        "parameters changed": changed or "none",
        **_activity_values(activity),
    }
    message = "; ".join(filter(None, complaints)) or f"serving {served.path.name}"
    if changed:
        message = f"{message}; parameters changed since the start: {changed}"
    return _status(name, "model", level, message, values, public)


def gap_status(name: str, public: PublicText, opening: Opening) -> DiagnosticStatus:
    """Return the status of the gap between the bench samples that came and the model in service."""
    level = DiagnosticStatus.WARN if opening.open else DiagnosticStatus.OK
    values = {
        key.replace("_", " "): _in_words(value)
        for key, value in opening.to_dict().items()
    }
    return _status(name, "gap", level, str(opening), values, public)


def _extrapolation(
    served: InService, point: OperatingPoint | None, oil_temperature: float | None
) -> str:
    """Return which inputs lie outside the data of the identification; empty when none does."""
    if point is None:
        return ""
    return "; ".join(served.model.departures(*point, oil_temperature))


def _activity_values(activity: Activity) -> dict[str, Any]:
    running: Any = _NOTHING
    if activity.job is not None and activity.job.working:
        running = activity.job
    return {
        "stage of the last bench sample": activity.sample_stage or _NOTHING,
        "last refit": activity.ends["reidentify"],
        "staged refit": activity.staged or _NOTHING,
        "last diagnosis": activity.ends["diagnose"],
        **activity.gap,
        "running": running,
    }


def _in_words(value: Any) -> str:
    if value is None:
        return _NOTHING
    if isinstance(value, tuple):
        return " to ".join(_in_words(part) for part in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)


def _refit_warnings(served: InService) -> str:
    warnings = served.model.provenance.get("warnings", [])
    if isinstance(warnings, list):
        return "; ".join(str(warning) for warning in warnings)
    return str(warnings)


def _status(
    node: str,
    part: str,
    level: bytes,
    message: str,
    values: Mapping[str, Any],
    public: PublicText,
) -> DiagnosticStatus:
    return DiagnosticStatus(
        name=f"{node}: {part}",
        hardware_id=node,
        level=level,
        message=public(message),
        values=[
            KeyValue(key=key, value=public(str(value))) for key, value in values.items()
        ],
    )

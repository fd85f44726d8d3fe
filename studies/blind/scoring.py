# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Scores of a blind trial, with Wilson intervals; records in, text out."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from studies.blind.conditions import REFERENCE
from studies.blind.trial import DETECTABLE
from studies.page import render, table

Record = dict[str, Any]
_SET_SIZE = 3
_FIRST_GOAL = 0.85


def rate(records: Sequence[Record], hit: Callable[[Record], bool]) -> str:
    """Return hits / total, the rate and its interval, as text."""
    return _rate(*_count(records, hit))


def _count(records: Sequence[Record], hit: Callable[[Record], bool]) -> tuple[int, int]:
    return sum(map(hit, records)), len(records)


def _rate(hits: int, total: int) -> str:
    if total == 0:
        return "none"
    low, high = binomtest(hits, total).proportion_ci(method="wilson")
    return f"{hits}/{total} = {100 * hits / total:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


# --- groups -----------------------------------------------------------------------------------


def single_known(records: Sequence[Record]) -> list[Record]:
    """One known effect, still detectable after the refit."""
    return [r for r in _detectable(records, 1) if r["known"]]


def unlisted(records: Sequence[Record]) -> list[Record]:
    """One effect that is in nobody's library, detectable."""
    return [r for r in _detectable(records, 1) if not r["known"]]


def nothing(records: Sequence[Record]) -> list[Record]:
    """No effect."""
    return [r for r in records if not r["truth"]]


def _detectable(records: Sequence[Record], effects: int) -> list[Record]:
    return [r for r in records if len(r["truth"]) == effects and r["left"] >= DETECTABLE]


# --- questions --------------------------------------------------------------------------------


def first_is_right(record: Record) -> bool:
    """Whether the first cause is the true one."""
    return bool(record["causes"]) and record["causes"][0]["effect"] in record["truth"]


def set_holds_truth(record: Record) -> bool:
    """Whether the first cause and what it cannot be told from, at most three, hold the truth."""
    return bool(record["causes"]) and bool(
        set(record["causes"][0]["set"][:_SET_SIZE]) & set(record["truth"])
    )


def alarmed(record: Record) -> bool:
    """Whether a gap was called."""
    return record["verdict"] != "no_gap"


def refused(record: Record) -> bool:
    """Whether no name was given to the gap."""
    return record["verdict"] == "unexplained"


def both_found(record: Record) -> bool:
    """Whether both effects of a pair are among the first three causes."""
    named = {cause["effect"] for cause in record["causes"][:3]}
    return set(record["truth"]) <= named


def misses(records: Sequence[Record]) -> list[float]:
    """|promised - met| shrinkage, squared units."""
    return [abs(r["promised"] - r["met"]) for r in records
            if r["promised"] is not None and r["met"] is not None]


# --- tables -------------------------------------------------------------------------------------


def report(records: Sequence[Record], command: str) -> str:
    """Return the whole score, and the command that wrote it, as Markdown."""
    reference = [r for r in records if r["condition"] == REFERENCE]
    return render(
        "report.md.j2", Path(__file__).parent, command=command, detectable=DETECTABLE,
        headline=_headline(summary(reference)) if reference else "",
        low=_below_the_goal(single_known(reference)), by_effect=_by_effect(reference),
        confusion=_confusion(reference), calibration=_calibration(reference),
        conditions=_conditions(records))


def summary(records: Sequence[Record]) -> dict[str, Any]:
    """Return the headline figures as plain data; of a rate hits and total."""
    known, strange = single_known(records), unlisted(records)
    right = [r["met"] for r in known if first_is_right(r) and r["met"] is not None]
    off = misses(known)
    absorbed = [r for r in records if len(r["truth"]) == 1 and r["left"] < DETECTABLE]
    return {
        "first_right": _count(known, first_is_right),
        "set_holds_truth": _count(known, set_holds_truth),
        "false_alarms": _count(nothing(records), alarmed),
        "unlisted_refused": _count(strange, refused),
        "unlisted_place_found": _count(strange, lambda r: bool(r["place_found"])),
        "listed_refused": _count(known, refused),
        "promise_median_miss": float(np.median(off)) if off else None,
        "gap_gone_median": float(np.median(right)) if right else None,
        "gap_gone_85": (sum(met >= 0.85 for met in right), len(right)),
        "pairs_both_found": _count(_detectable(records, 2), both_found),
        "undetectable": dict(Counter(r["verdict"] for r in absorbed)),
    }


def _headline(found: dict[str, Any]) -> str:
    absorbed = Counter(found["undetectable"])
    return table(("", "measured", "goal"), [
        ("right cause first", _rate(*found["first_right"]), f"{100 * _FIRST_GOAL:.0f} %"),
        (f"right cause in a set of at most {_SET_SIZE}", _rate(*found["set_holds_truth"]), "95 %"),
        ("false alarms, no effect", _rate(*found["false_alarms"]), "at most 5 %"),
        ("unlisted effects refused", _rate(*found["unlisted_refused"]), "85 %"),
        ("place of unlisted effects found", _rate(*found["unlisted_place_found"]), ""),
        ("listed effects refused", _rate(*found["listed_refused"]), "at most 5 %"),
        ("median |promised - met| shrinkage", _number(found["promise_median_miss"]),
         "at most 0.10"),
        ("squared gap gone, median, right cause added", _number(found["gap_gone_median"]), "0.85"),
        ("at least 85 % of the squared gap gone", _rate(*found["gap_gone_85"]), ""),
        ("pairs: both among the first three", _rate(*found["pairs_both_found"]), ""),
        ("undetectable: no_gap or ambiguous",
         _rate(absorbed["no_gap"] + absorbed["ambiguous"], absorbed.total()), ""),
    ])


def _below_the_goal(records: Sequence[Record]) -> list[str]:
    """Name the effects that the rate over all of them hides."""
    low = []
    for name in sorted({r["truth"][0] for r in records}):
        first, count = _count([r for r in records if r["truth"] == [name]], first_is_right)
        if first < _FIRST_GOAL * count:
            low.append(f"{name} ({first} of {count})")
    return low


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.3f}"


def _by_effect(records: Sequence[Record]) -> str:
    rows = []
    for name in sorted({r["truth"][0] for r in records if len(r["truth"]) == 1}):
        own = [r for r in records if r["truth"] == [name]]
        seen = [r for r in own if r["left"] >= DETECTABLE]
        off = misses(seen)
        rows.append((name, len(own), len(seen), rate(seen, first_is_right),
                     rate(seen, set_holds_truth), rate(seen, refused), _median(off)))
    return table(
        ("true effect", "campaigns", "detectable", "first", "in the set", "refused",
         "median miss of the promise"), rows)


def _median(values: Sequence[float]) -> str:
    return f"{np.median(values):.2f}" if values else ""


def _confusion(records: Sequence[Record]) -> str:
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for r in records:
        if len(r["truth"]) > 1 or (r["truth"] and r["left"] < DETECTABLE):
            continue
        truth = r["truth"][0] if r["truth"] else "(none)"
        if r["verdict"] in ("no_gap", "unexplained"):
            counts[truth][r["verdict"]] += 1
        else:
            counts[truth][r["causes"][0]["effect"]] += 1
    answers = sorted({answer for row in counts.values() for answer in row})
    rows = [(truth, *(counts[truth][answer] or "" for answer in answers))
            for truth in sorted(counts)]
    return table(("", *answers), rows)


def _calibration(records: Sequence[Record]) -> str:
    known = [r for r in single_known(records) if r["causes"] and r["verdict"] != "unexplained"]
    rows = []
    for low, high in ((0.0, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.98), (0.98, 1.01)):
        inside = [r for r in known if low <= r["causes"][0]["probability"] < high]
        said = [r["causes"][0]["probability"] for r in inside]
        rows.append((f"{low:.2f} to {min(high, 1.0):.2f}",
                     f"{np.mean(said):.2f}" if said else "", rate(inside, first_is_right)))
    return table(("probability of the first cause", "mean said", "right"), rows)


def _conditions(records: Sequence[Record]) -> str:
    names = list(dict.fromkeys(r["condition"] for r in records))
    rows = []
    for name in names:
        own = [r for r in records if r["condition"] == name]
        known, off = single_known(own), misses(single_known(own))
        rows.append((name, rate(known, first_is_right), rate(known, set_holds_truth),
                     rate(nothing(own), alarmed), rate(unlisted(own), refused), _median(off)))
    return table(
        ("condition", "first", "in a set of three", "false alarms", "unlisted refused",
         "median miss of the promise"), rows)

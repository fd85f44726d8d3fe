# SPDX-License-Identifier: Apache-2.0
"""Scores of a blind trial, with Wilson intervals; records in, text out."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from studies.blind.conditions import REFERENCE
from studies.blind.trial import DETECTABLE

Record = dict[str, Any]
_SET_SIZE = 3
_FIRST_GOAL = 0.85
_Z = 1.959964  # two-sided 95 %
HOW = """\
The campaigns come from a plant written apart from the served model (`studies/blind`), with effects
in other functional forms than the library of the diagnosis has. Blind is the command, not this
program: `hmcvt diagnose` runs as a process of its own and gets a CSV file with contract columns;
plant and answer are compared afterwards.

"""


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % interval of a rate (Wilson 1927); (0, 1) without trials."""
    if total == 0:
        return 0.0, 1.0
    rate, z2 = hits / total, _Z**2
    middle = (rate + z2 / (2 * total)) / (1 + z2 / total)
    half = _Z * np.sqrt(rate * (1 - rate) / total + z2 / (4 * total**2)) / (1 + z2 / total)
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def rate(records: Sequence[Record], hit: Callable[[Record], bool]) -> str:
    """Return hits / total, the rate and its interval, as text."""
    hits, total = sum(1 for record in records if hit(record)), len(records)
    if total == 0:
        return "none"
    low, high = wilson(hits, total)
    return f"{hits}/{total} = {100 * hits / total:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


# --- groups -----------------------------------------------------------------------------------


def single_known(records: Sequence[Record]) -> list[Record]:
    """One known effect, still detectable after the refit."""
    return [r for r in records if len(r["truth"]) == 1 and r["known"] and r["left"] >= DETECTABLE]


def undetectable(records: Sequence[Record]) -> list[Record]:
    """One effect that the refit absorbs."""
    return [r for r in records if len(r["truth"]) == 1 and r["left"] < DETECTABLE]


def unlisted(records: Sequence[Record]) -> list[Record]:
    """One effect that is in nobody's library, detectable."""
    return [r for r in records
            if len(r["truth"]) == 1 and not r["known"] and r["left"] >= DETECTABLE]


def nothing(records: Sequence[Record]) -> list[Record]:
    """No effect."""
    return [r for r in records if not r["truth"]]


def pairs(records: Sequence[Record]) -> list[Record]:
    """Two effects, together detectable."""
    return [r for r in records if len(r["truth"]) == 2 and r["left"] >= DETECTABLE]


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


def report(records: Sequence[Record]) -> str:
    """Return the whole score as Markdown."""
    reference = [r for r in records if r["condition"] == REFERENCE]
    parts = [_summary(reference), _by_effect(reference), _confusion(reference),
             _calibration(reference), _conditions(records)]
    return "\n\n".join(part for part in parts if part) + "\n"


def summary(records: Sequence[Record]) -> dict[str, Any]:
    """Return the headline figures as plain data."""
    known = single_known(records)
    right = [r["met"] for r in known if first_is_right(r) and r["met"] is not None]
    gone = [value >= 0.85 for value in right]
    off = misses(known)
    return {
        "first_right": _plain(known, first_is_right),
        "set_holds_truth": _plain(known, set_holds_truth),
        "false_alarms": _plain(nothing(records), alarmed),
        "unlisted_refused": _plain(unlisted(records), refused),
        "unlisted_place_found": _plain(unlisted(records), lambda r: bool(r["place_found"])),
        "listed_refused": _plain(known, refused),
        "promise_median_miss": float(np.median(off)) if off else None,
        "gap_gone_median": float(np.median(right)) if right else None,
        "gap_gone_85": [sum(gone), len(gone)],
        "pairs_both_found": _plain(pairs(records), both_found),
        "undetectable": dict(Counter(r["verdict"] for r in undetectable(records))),
    }


def _plain(records: Sequence[Record], hit: Callable[[Record], bool]) -> list[int]:
    return [sum(1 for record in records if hit(record)), len(records)]


def _summary(records: Sequence[Record]) -> str:
    if not records:
        return ""
    known = single_known(records)
    found = summary(records)
    right = [r for r in known if first_is_right(r) and r["met"] is not None]
    quiet = rate(undetectable(records), lambda r: r["verdict"] in ("no_gap", "ambiguous"))
    rows = [
        ("right cause first", rate(known, first_is_right), f"{100 * _FIRST_GOAL:.0f} %"),
        (f"right cause in a set of at most {_SET_SIZE}", rate(known, set_holds_truth), "95 %"),
        ("false alarms, no effect", rate(nothing(records), alarmed), "at most 5 %"),
        ("unlisted effects refused", rate(unlisted(records), refused), "85 %"),
        ("place of unlisted effects found",
         rate(unlisted(records), lambda r: bool(r["place_found"])), ""),
        ("listed effects refused", rate(known, refused), "at most 5 %"),
        ("median |promised - met| shrinkage", _number(found["promise_median_miss"]),
         "at most 0.10"),
        ("squared gap gone, median, right cause added", _number(found["gap_gone_median"]), "0.85"),
        ("at least 85 % of the squared gap gone", rate(right, lambda r: r["met"] >= 0.85), ""),
        ("pairs: both among the first three", rate(pairs(records), both_found), ""),
        ("undetectable: no_gap or ambiguous", quiet, ""),
    ]
    return (
        "## Reference conditions\n\nNoise 0.4 % of efficiency, 0.1 % of output speed, 96 "
        "random operating points. Of the campaigns with an effect those count where it is "
        f"detectable: a refit of the base parameters leaves at least {DETECTABLE:g} of it, in "
        "squared standard deviations over all samples. The others stand in the last row.\n\n"
        + _table(("", "measured", "goal"), rows)
        + _below_the_goal(known)
    )


def _below_the_goal(records: Sequence[Record]) -> str:
    """Name the effects that the rate over all of them hides."""
    low = []
    for name in sorted({r["truth"][0] for r in records}):
        first, count = _plain([r for r in records if r["truth"] == [name]], first_is_right)
        if first < _FIRST_GOAL * count:
            low.append(f"{name} ({first} of {count})")
    return f"\n\nBelow that goal for the right cause first: {', '.join(low)}." if low else ""


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
    return "## By effect\n\n" + _table(
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
    return ("## Confusion\n\nRows: what was switched on (detectable cases). Columns: the answer.\n"
            "\n" + _table(("", *answers), rows))


def _calibration(records: Sequence[Record]) -> str:
    known = [r for r in single_known(records) if r["causes"] and r["verdict"] != "unexplained"]
    rows = []
    for low, high in ((0.0, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 0.98), (0.98, 1.01)):
        inside = [r for r in known if low <= r["causes"][0]["probability"] < high]
        said = [r["causes"][0]["probability"] for r in inside]
        rows.append((f"{low:.2f} to {min(high, 1.0):.2f}",
                     f"{np.mean(said):.2f}" if said else "", rate(inside, first_is_right)))
    return "## Are the probabilities right?\n\n" + _table(
        ("probability of the first cause", "mean said", "right"), rows)


def _conditions(records: Sequence[Record]) -> str:
    names = list(dict.fromkeys(r["condition"] for r in records))
    rows = []
    for name in names:
        own = [r for r in records if r["condition"] == name]
        known, off = single_known(own), misses(single_known(own))
        rows.append((name, rate(known, first_is_right), rate(known, set_holds_truth),
                     rate(nothing(own), alarmed), rate(unlisted(own), refused), _median(off)))
    return "## Other conditions and stress\n\n" + _table(
        ("condition", "first", "in a set of three", "false alarms", "unlisted refused",
         "median miss of the promise"), rows)


def _table(head: Sequence[object], rows: Sequence[Sequence[object]]) -> str:
    lines = [_row(head), "|" + " --- |" * len(head), *map(_row, rows)]
    return "\n".join(lines)


def _row(cells: Sequence[object]) -> str:
    # A bar within a cell would end it.
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"

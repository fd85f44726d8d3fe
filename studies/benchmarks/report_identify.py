# SPDX-License-Identifier: Apache-2.0
"""The part of docs/benchmarks.md on identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.soak.goals import Goal, table

from .bench_identify import CASES, WITHIN
from .record import Entry, Figure, Record, Spread, short
from .searches import OURS, SEARCHES, SINGLE_START, Search

FASTER = 5.0


def goals(record: Record) -> list[Goal]:
    """Return the goals of every case."""
    found = []
    for case in CASES:
        runs = _runs(record, case, OURS)
        arrived = sum(map(_arrived, runs))
        found.append(Goal(f"{case}: `hmcvt.identify` reaches the lowest value", "every seed",
                          f"{arrived} of {len(runs)} seeds", arrived == len(runs)))
        for words, figure in (("until it returns", _seconds), ("until the value is met", _reached)):
            ratio, search = min(
                ((_ratio(record, case, search, figure), search)
                 for search in SEARCHES if search.kind == "global"),
                key=lambda item: np.nan_to_num(item[0].median, nan=np.inf))
            found.append(Goal(f"{case}: fastest other global search {words} / ours",
                              f"at least {FASTER:g}", f"{ratio.text()}, {search.name}",
                              ratio.median >= FASTER))
    return found


def section(record: Record) -> list[str]:
    """Return the section."""
    lines = [
        "## Identification", "",
        "Three parameters within the same bounds, the same function to minimise, one that takes "
        "many candidates at once where the search can use that. A run arrives when it comes within "
        f"{WITHIN:g} (relative) of the lowest value that anyone found. Nobody is told that value: "
        "what a user waits for is the time until it returns. Settings are the libraries' own. The "
        "slow ones get fewer seeds; the same seeds are timed in turns.", ""]
    for case in CASES:
        lines += [f"### {case[0].upper()}{case[1:]}", "", *_case(record, case), ""]
    return [
        *lines,
        "- Evaluations are candidates, whole runs, median. Times are those of `hmcvt.identify` = "
        "1, which includes standard errors and warnings. The value counts as met at the first "
        "candidate that meets it, over the runs that do.",
        "- `least_squares` is a local search: from one random start it arrived in "
        f"{_share(record, SINGLE_START)} runs. `hmcvt.identify` ends with one of its kind, from "
        "four points at once; what it takes beyond that is the price of looking for other valleys "
        "first.",
        "- The rows under `hmcvt.identify` are its parts: the published schedule without and with "
        "the finish, and the chains that it uses instead, without the finish.",
    ]


def _case(record: Record, case: str) -> list[str]:
    rows = [_row(record, case, search) for search in SEARCHES]
    lowest = record.one("bench_identify", case=case).told["lowest"]
    best = min(entry.told["value"] for entry in record.select("bench_identify", case=case))
    seconds = record.spread("bench_identify", _seconds, case=case, search=OURS).median
    return [
        *table(("", "arrived", "evaluations", "until it returns / ours",
                "until the value is met / ours"), rows), "",
        f"Ours: {short(1e3 * seconds)} ms. The lowest value by least squares from 64 points is "
        f"{lowest:.8g}, by any of these runs {best:.8g}."]


def _row(record: Record, case: str, search: Search) -> Sequence[str]:
    runs = _runs(record, case, search.name)
    evaluations = np.median([entry.told["evaluations"] for entry in runs])
    return [search.name, f"{sum(map(_arrived, runs))} of {len(runs)}", f"{evaluations:.0f}",
            *("1" if search.kind == "ours" else _ratio(record, case, search, figure).text()
              for figure in (_seconds, _reached))]


def _runs(record: Record, case: str, name: str) -> list[Entry]:
    return record.select("bench_identify", case=case, search=name)


def _ratio(record: Record, case: str, search: Search, figure: Figure) -> Spread:
    return record.ratio("bench_identify", {"case": case, "search": search.name},
                        {"case": case, "search": OURS}, figure, turn="seed")


def _share(record: Record, name: str) -> str:
    """How many runs of a search arrived, over all cases."""
    runs = record.select("bench_identify", search=name)
    return f"{sum(map(_arrived, runs))} of {len(runs)}"


def _arrived(entry: Entry) -> bool:
    return entry.told["reached_seconds"] is not None


def _seconds(entry: Entry) -> float:
    return entry.seconds


def _reached(entry: Entry) -> float:
    return entry.told["reached_seconds"] if _arrived(entry) else np.nan


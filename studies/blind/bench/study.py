# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Runs of many campaigns on the bench."""

import json
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_tools.fleet.executors import Processes
from studies.blind.bench.judge import FRESH_TESTS, Case, judge
from studies.blind.bench.properties import PROPERTIES, Bench
from studies.blind.bench.scores import (
    DETECTABLE,
    Record,
    band_table,
    cost_table,
    member_table,
    misses,
    score_table,
    unlisted_table,
)
from studies.blind.bench.truth import KINDS, USUAL_KINDS
from studies.page import render

#: Seeds from here on are kept back from development.
KEPT_BACK = 90_000_000


def cases(
    campaigns: int, first_seed: int, bench: Bench, kinds: Sequence[str] = ()
) -> list[Case]:
    """Return the campaigns of a run; a longer run begins with those of a shorter one.

    Args:
        campaigns: number of campaigns.
        first_seed: of the first; the others count up.
        bench: properties of the bench.
        kinds: of campaign; empty for the usual ones.
    """
    cycle = _cycle(kinds or USUAL_KINDS)
    return [
        Case(cycle[i % len(cycle)], first_seed + i, bench) for i in range(campaigns)
    ]


def _cycle(kinds: Sequence[str]) -> list[str]:
    """Return kinds in an order in which each comes as often as it is to, evenly mixed."""
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(
                f"kind {kind!r} does not exist, expected one of {list(KINDS)}"
            )
    total = sum(KINDS[kind] for kind in kinds)
    turns: list[str] = []
    due = dict.fromkeys(kinds, 0.0)
    for _ in range(total):
        for kind in kinds:
            due[kind] += KINDS[kind] / total
        most = max(due, key=lambda kind: due[kind])
        due[most] -= 1.0
        turns.append(most)
    return turns


def run(
    work: Sequence[Case], jobs: int, progress: Callable[[str], None]
) -> list[Record]:
    """Diagnose every campaign; records in the order of the cases.

    A campaign that cannot be drawn, or whose diagnosis raises an error, has the key `error`.
    """
    records: dict[str, Record] = {}
    with Processes(jobs) as pool:
        waiting = {pool.submit(judged, case): case.key for case in work}
        for future in as_completed(waiting):
            records[waiting[future]] = future.result()
            progress(f"{len(records)} of {len(work)} campaigns")
    return [records[case.key] for case in work]


def judged(case: Case) -> Record:
    """Return the record of a campaign, or why there is none under `error`."""
    try:
        return judge(case)
    except InputError as error:
        return {"kind": case.kind, "seed": case.seed, "error": str(error)}


def report(records: Sequence[Record]) -> str:
    """Return the tables of a run."""
    usable = [record for record in records if "error" not in record]
    parts = [
        score_table(usable),
        band_table(usable),
        member_table(usable),
        unlisted_table(usable),
        misses(usable),
    ]
    for record in records:
        if "error" in record:
            parts.append(f"{record['kind']}/{record['seed']}: {record['error']}")
    return "\n\n".join(part for part in parts if part)


def cost(
    campaigns: int,
    seed: int,
    jobs: int,
    kinds: Sequence[str],
    progress: Callable[[str], None],
) -> tuple[str, dict[str, list[Record]]]:
    """Run the same campaigns with each property switched off in turn.

    Returns:
        The table, and the records of each run by what is switched off; first `nothing`.
    """
    runs: dict[str, list[Record]] = {}
    for name in ("nothing", *PROPERTIES):
        bench = Bench() if name == "nothing" else Bench().without(name)
        progress(f"without {name}")
        runs[name] = run(cases(campaigns, seed, bench, kinds), jobs, progress)
    usable = {
        name: [record for record in records if "error" not in record]
        for name, records in runs.items()
    }
    return cost_table(usable), runs


def page(
    records: Sequence[Record], command: str, first_seed: int, cost_lines: str = ""
) -> str:
    """Return the section of the page of the blind trial, in Markdown.

    Args:
        records: of a run.
        command: that made them.
        first_seed: of the run.
        cost_lines: table of `cost`; empty to leave it out.
    """
    usable = [record for record in records if "error" not in record]
    kept_back = first_seed >= KEPT_BACK
    return render(
        "report.md.j2",
        Path(__file__).parent,
        command=command,
        seeds="kept back from development" if kept_back else "used in development",
        detectable=DETECTABLE,
        fresh=FRESH_TESTS,
        scores=score_table(usable),
        bands=band_table(usable),
        members=member_table(usable),
        unlisted=unlisted_table(usable),
        cost=cost_lines,
    )


def save(path: Path, content: Any) -> None:
    """Write records as JSON."""
    write_atomically(path, json.dumps(content, indent=1) + "\n")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Runs of many campaigns on the renewed plant."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hmcvt_core.errors import InputError
from hmcvt_tools.fleet.executors import Processes
from studies.blind.bench.judge import FRESH_TESTS
from studies.blind.bench.scores import Record, exact_first, member_table
from studies.blind.renewed.campaign import KINDS, VERSION
from studies.blind.renewed.judge import CHANNELS, EFFECTS, ERRORS, Case, judge
from studies.blind.renewed.scores import (
    VISIBLE,
    answered_accessory,
    band_table,
    drawn,
    false_member_table,
    promise_table,
    score_table,
)
from studies.page import render, table
from studies.workers import recorded

#: Seeds from here on are kept back from development.
KEPT_BACK = 97_500_000


def cases(
    campaigns: int,
    first_seed: int,
    kinds: Sequence[str] = (),
    without: Sequence[str] = (),
    oracle: bool = True,
) -> dict[str, Case]:
    """Return the campaigns of a run; a longer run begins with those of a shorter one.

    Args:
        campaigns: number of campaigns.
        first_seed: of the first; the others count up.
        kinds: of campaign; empty for all.
        without: columns to leave out, `ERRORS` that are to be missing, and effects that the
            library is to lack.
        oracle: whether the oracle is asked too.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(
                f"kind {kind!r} does not exist, expected one of {list(KINDS)}"
            )
    known = (*CHANNELS, *ERRORS, *EFFECTS)
    for name in without:
        if name not in known:
            raise InputError(
                f"{name!r} cannot be left out of the renewed plant, expected one of {known}"
            )
    turns = _turns(kinds or tuple(KINDS))
    work = [
        Case(turns[i % len(turns)], first_seed + i, oracle, tuple(without))
        for i in range(campaigns)
    ]
    return {f"{case.key} without {'+'.join(without)}": case for case in work}


def _turns(kinds: Sequence[str]) -> list[str]:
    """Return kinds in an order in which each comes as often as it is to, evenly mixed."""
    total = sum(KINDS[kind] for kind in kinds)
    turns = []
    due = dict.fromkeys(kinds, 0.0)
    for _ in range(total):
        for kind in kinds:
            due[kind] += KINDS[kind] / total
        most = max(due, key=lambda kind: due[kind])
        due[most] -= 1.0
        turns.append(most)
    return turns


def judged(case: Case) -> Record:
    """Return the record of a campaign, or why there is none under `error`."""
    try:
        return judge(case)
    except InputError as error:
        return {"kind": case.kind, "seed": case.seed, "error": str(error)}


def run(
    work: dict[str, Case], jobs: int, path: Path, progress: Callable[[str], None]
) -> list[Record]:
    """Diagnose every campaign, in the order of the cases.

    Args:
        work: cases by key.
        jobs: processes.
        path: file of JSON lines from which an interrupted run goes on.
        progress: called with a line of text for each campaign.
    """
    records: dict[str, Record] = {}
    with Processes(jobs) as pool:
        for record in recorded(pool, judged, work, path):
            records[f"{record['kind']}/{record['seed']}"] = record
            progress(f"{len(records)} of {len(work)} campaigns")
    return [records[case.key] for case in work.values()]


def paired(
    whole: Sequence[Record], part: Sequence[Record], without: str
) -> dict[str, int]:
    """Return how a column, or an effect in the library, changes the exact answers.

    Campaigns whose bench lacks the column, or that hide the effect, are not counted.

    Args:
        whole: records with it.
        part: records of the same campaigns without it.
        without: name of the column or the effect.
    """
    others = {(record["kind"], record["seed"]): record for record in part}
    counts = {"both": 0, "only with it": 0, "only without it": 0, "neither": 0}
    for record in whole:
        other = others[record["kind"], record["seed"]]
        if "error" in record or "error" in other or not _concerns(record, without):
            continue
        answers = (_right(record), _right(other))
        index = (3, 2, 1, 0)[2 * answers[0] + answers[1]]
        counts[list(counts)[index]] += 1
    return counts


def paired_table(head: str, counts: Mapping[str, Mapping[str, int]]) -> str:
    """Return `paired` by what is left out.

    Args:
        head: what is left out.
        counts: by its name.
    """
    rows = [(f"`{name}`", *item.values()) for name, item in counts.items()]
    return table((head, *next(iter(counts.values()))), rows)


def _concerns(record: Record, without: str) -> bool:
    """Whether a campaign with listed effects tells what a column or an effect is worth."""
    if record["kind"] not in ("single", "pair", "triple", "accessory"):
        return False
    if without in CHANNELS:
        return without in record["columns"]
    return without not in (*record["truth"], *record["true_classes"])


def _right(record: Record) -> bool:
    if record["kind"] == "accessory":
        return answered_accessory(record)
    return exact_first(record)


def page(records: Sequence[Record], command: str, first_seed: int) -> str:
    """Return the section of the page of the blind trial, in Markdown.

    Args:
        records: of a run.
        command: that made them.
        first_seed: of the run.
    """
    usable = drawn(records)
    kept_back = first_seed >= KEPT_BACK
    return render(
        "report.md.j2",
        Path(__file__).parent,
        command=command,
        version=VERSION,
        seeds="kept back from development" if kept_back else "used in development",
        visible=VISIBLE,
        fresh=FRESH_TESTS,
        scores=score_table(usable),
        promise=promise_table(usable),
        bands=band_table(usable),
        members=member_table(usable),
        false_members=false_member_table(usable),
        unusable=len(records) - len(usable),
    )

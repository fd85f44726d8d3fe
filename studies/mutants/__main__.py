# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.mutants`: try random mutants of the core on the tests."""

import argparse
import os
import random
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from studies.page import render, table
from studies.workers import Record, recorded

from .harness import KILLED, NO_EFFECT, ROOT, SURVIVED, Copies, in_copy, reaches, trial
from .mutations import Mutation, mutations

GOAL = 0.85
_say = partial(print, file=sys.stderr, flush=True)
_TESTS = "tests/core", "tests/diagnosis", "tests/units"
_ROOMS = ("physics", "model", "identification", "diagnosis", "benches", "transmission")


def main() -> int:
    """Run it; 0 when the goal is met."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.mutants", description=__doc__
    )
    parser.add_argument("--count", type=int, default=200, help="mutants (%(default)s)")
    parser.add_argument(
        "--seed", type=int, default=0, help="that draws them (%(default)s)"
    )
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="side by side"
    )
    parser.add_argument(
        "--rooms", nargs="+", default=_ROOMS, help="folders of hmcvt_core"
    )
    parser.add_argument("--tests", nargs="+", default=_TESTS)
    parser.add_argument(
        "--folder",
        type=Path,
        default=Path("build/mutants"),
        help="copies and results; an interrupted run goes on from here",
    )
    parser.add_argument(
        "--out", type=Path, default=Path(os.devnull), help="write the report there, too"
    )
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    folder = given.folder.resolve()
    copies = Copies(folder, given.jobs)
    reach = reaches(copies, folder, given.tests, given.jobs, _say)
    reference, start = folder / "answers.json", time.monotonic()
    with copies.one() as copy:
        answers = in_copy(copy, ["-m", "studies.mutants.probe"])
    seconds = time.monotonic() - start
    if answers.returncode != 0:
        raise RuntimeError(f"the probe fails without any mutant:\n{answers.stderr}")
    reference.write_text(answers.stdout, encoding="utf-8")
    drawn = {
        mutation.key: mutation
        for mutation in draw(given.rooms, given.count, given.seed)
    }

    def work(mutation: Mutation) -> Record:
        with copies.one() as copy:
            return trial(copy, mutation, reach, reference, seconds)

    records: list[Record] = []
    with ThreadPoolExecutor(given.jobs) as pool:
        for record in recorded(
            pool, work, drawn, folder / f"results-{copies.state}.jsonl"
        ):
            records.append(record)
            _say(
                f"{len(records)} of {len(drawn)}: {record['outcome']}: {record['key']}"
            )
    text = report(records, f"{given.count} drawn with seed {given.seed}")
    print(text)
    given.out.write_text(text, encoding="utf-8")
    return 0 if share(records) >= GOAL else 1


def draw(rooms: Sequence[str], count: int, seed: int) -> list[Mutation]:
    """Draw mutants, every one as likely as the other."""
    every = [
        mutation
        for room in rooms
        for path in sorted((ROOT / "hmcvt_core" / room).rglob("*.py"))
        for mutation in mutations(str(path.relative_to(ROOT)), path.read_bytes())
    ]
    return random.Random(seed).sample(every, min(count, len(every)))


def share(records: Sequence[Record]) -> float:
    """Killed, of those that change an answer."""
    counts = Counter(record["outcome"] for record in records)
    return counts[KILLED] / max(1, counts[KILLED] + counts[SURVIVED])


def report(records: Sequence[Record], what: str) -> str:
    """Tell how many were noticed, and show those that were not."""
    kinds = {
        outcome: sorted(
            (record for record in records if record["outcome"] == outcome),
            key=lambda record: str(record["key"]),
        )
        for outcome in (KILLED, SURVIVED, NO_EFFECT)
    }
    files = Counter(
        f"`{str(record['diff']).splitlines()[0].removeprefix('--- ')}`"
        for record in kinds[SURVIVED]
    )
    return render(
        "report.md.j2",
        Path(__file__).parent,
        what=what,
        share=share(records),
        goal=GOAL,
        kinds=kinds,
        survived=table(("file", "survived"), sorted(files.items())),
    )


if __name__ == "__main__":
    sys.exit(main())

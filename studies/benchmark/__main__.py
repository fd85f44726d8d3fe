# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.benchmark`: make the cases, have every method answer, write the page."""

import argparse
import shlex
import sys
import traceback
from collections.abc import Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from hmcvt_tools.fleet.executors import Processes
from studies.benchmark import generator, rig
from studies.benchmark.methods import METHODS
from studies.benchmark.page import page
from studies.benchmark.running import make, run


def work(jobs: int, calls: Sequence[tuple[Any, ...]]) -> bool:
    """Call functions in processes; print what each returns; return whether all succeeded."""
    failed = False
    with Processes(jobs) as pool:
        waiting = {pool.submit(*call): call[1:] for call in calls}
        for number, future in enumerate(as_completed(waiting), 1):
            try:
                text = future.result()
            except Exception:  # whatever a method may raise; the others go on
                failed = True
                _, *what = waiting[future]
                text = f"{' '.join(map(str, what))} FAILED:\n{traceback.format_exc()}"
            print(f"{number} of {len(waiting)}: {text}", flush=True)
    return not failed


def main() -> None:
    """Run what is not there yet, and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.benchmark",
        description="Compare methods on one set of cases.",
    )
    parser.add_argument(
        "--campaigns",
        type=int,
        default=100,
        help="simulated cases; the measured ones are always there",
    )
    parser.add_argument("--first-seed", type=int, default=generator.TABLE_SEEDS)
    parser.add_argument("--folder", type=Path, default=Path("build/benchmark"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--method", action="append", choices=list(METHODS))
    parser.add_argument("--page", type=Path, help="such as docs/studies/benchmark.md")
    options = parser.parse_args()
    names = generator.names_of(options.campaigns)
    names += [(name, "", 0) for name in rig.rig_names()]
    calls: list[tuple[Any, ...]] = []
    for name, kind, number in names:
        seed = generator.seed_of(options.first_seed, number)
        calls.append((make, options.folder, name, kind, seed))
    complete = work(options.jobs, calls)
    calls = []
    for name, _, _ in names:
        for method in options.method or METHODS:
            if (options.folder / "truth" / f"{name}.yaml").is_file():
                calls.append((run, options.folder, name, method))
    complete = work(options.jobs, calls) and complete
    if options.page:
        command = shlex.join(["python", "-m", "studies.benchmark", *sys.argv[1:]])
        try:
            text = page(options.folder, command, options.first_seed)
        except ValueError as error:
            sys.exit(f"error: {error}")
        options.page.write_text(text, encoding="utf-8")
    if not complete:
        sys.exit("error: some work failed; see above")


if __name__ == "__main__":
    main()

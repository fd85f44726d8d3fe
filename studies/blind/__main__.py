# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.blind`."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from hmcvt_core.cli import run_command
from hmcvt_core.cli.common import OutputFile, json_option, print_json
from hmcvt_core.files.atomic import write_atomically
from studies.workers import recorded, workers

from .conditions import PARTS, REFERENCE, cases
from .scoring import report, summary
from .trial import score


@click.command("blind", epilog="""\b
Examples:
  python -m studies.blind --seeds 1 --part reference
  python -m studies.blind --seeds 20 --side-seeds 1 --out docs/blind.md""")
@click.option("--seeds", type=click.IntRange(1, 1000), default=6, show_default=True,
              help="Campaigns per effect in the reference conditions.")
@click.option("--side-seeds", type=click.IntRange(1, 1000), default=None,
              help="The same in every other condition.  [default: a third]")
@click.option("--part", "parts", type=click.Choice(PARTS), multiple=True, default=PARTS,
              help="What to run; may be given more than once.  [default: all]")
@click.option("--jobs", type=click.IntRange(1, 256), default=os.cpu_count() or 1,
              show_default="cores", help="Diagnoses side by side.")
@click.option("--results", type=OutputFile(), default="blind-results.jsonl", show_default=True,
              metavar="FILE",
              help="Records so far; an interrupted trial goes on from here.")
@click.option("--out", type=OutputFile(), default=None, metavar="REPORT.md",
              help="Write the report there too.")
@json_option
def command(
    seeds: int, side_seeds: int | None, parts: tuple[str, ...], jobs: int, results: str,
    out: str | None, as_json: bool,
) -> None:
    """Run the blind trial: campaigns of the twin, diagnosed through `hmcvt diagnose` alone."""
    side = max(1, seeds // 3) if side_seeds is None else side_seeds
    todo = cases(seeds, side, parts)
    records = []
    with workers(jobs) as pool:
        tasks = {case.key: case for case in todo}
        for number, record in enumerate(recorded(pool, score, tasks, Path(results)), 1):
            records.append(record)
            if sys.stderr.isatty() or number % 50 == 0:
                end = "\r" if sys.stderr.isatty() else "\n"
                click.echo(f"{number} of {len(todo)} campaigns{end}", err=True, nl=False)
    chosen = "" if parts == PARTS else "".join(f" --part {part}" for part in parts)
    text = report(
        records, f"python -m studies.blind --seeds {seeds} --side-seeds {side}{chosen}")
    if out is not None:
        write_atomically(Path(out), text)
    if as_json:
        reference_records = [r for r in records if r["condition"] == REFERENCE]
        print_json({"campaigns": len(records), "reference": summary(reference_records)})
    else:
        click.echo(text)


if __name__ == "__main__":
    run_command(command, "python -m studies.blind")

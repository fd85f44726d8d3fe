# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.blind`."""

import os
from pathlib import Path
from typing import Any

import click

from hmcvt_core.cli import run_command
from hmcvt_core.cli.common import OutputFile
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.fleet.executors import Processes
from studies.workers import recorded

from .conditions import PARTS, cases
from .loop import work
from .scoring import goals, misses, report

KEPT_BACK = 500_000_000  # seeds from here on are for the page alone


@click.command("blind")
@click.option(
    "--seeds",
    type=click.IntRange(1, 900),
    default=12,
    show_default=True,
    help="Campaigns per single effect at either noise.",
)
@click.option(
    "--seed-base",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help=f"First seed; those from {KEPT_BACK} on are kept back from development.",
)
@click.option(
    "--part",
    "parts",
    type=click.Choice(PARTS),
    multiple=True,
    default=PARTS,
    help="What to run; may be given more than once.  [default: all]",
)
@click.option(
    "--quick",
    is_flag=True,
    help="One campaign per effect at 0.4 %, or in the parts chosen: goals and misses.",
)
@click.option(
    "--only",
    default="",
    metavar="TEXT",
    help="Only campaigns with this in their name, as pair in `0.4 %/pair/24001`.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    default=os.cpu_count() or 1,
    show_default="cores",
    help="Diagnoses side by side.",
)
@click.option(
    "--results",
    type=OutputFile(),
    default=None,
    metavar="FILE",
    help="To go on after an interruption.  [default: blind-results.jsonl, --quick none]",
)
@click.option(
    "--out",
    type=OutputFile(),
    default=None,
    metavar="REPORT.md",
    help="Write the report there too.",
)
def command(
    seeds: int,
    seed_base: int,
    parts: tuple[str, ...],
    quick: bool,
    only: str,
    jobs: int,
    results: str | None,
    out: str | None,
) -> None:
    """Run the blind trial: the diagnosis gets the bench columns of the twin's campaigns alone."""
    if quick:
        seeds, parts = 1, parts if parts != PARTS else PARTS[:1]
    todo = {
        case.key: case for case in cases(seed_base, seeds, parts) if only in case.key
    }
    records: list[dict[str, Any]] = []
    with Processes(jobs) as pool:
        path = Path(results or (os.devnull if quick else "blind-results.jsonl"))
        for record in recorded(pool, work, todo, path):
            records.append(record)
            if len(records) % 10 == 0:
                click.echo(f"{len(records)} of {len(todo)} campaigns", err=True)
    chosen = "" if parts == PARTS else "".join(f' --part "{part}"' for part in parts)
    text = report(
        records,
        f"python -m studies.blind --seeds {seeds} --seed-base {seed_base}{chosen}",
        "kept back from development"
        if seed_base >= KEPT_BACK
        else "used in development",
    )
    if out is not None:
        write_atomically(Path(out), text)
    click.echo(f"{goals(records)}\n\n{misses(records)}" if quick else text)


if __name__ == "__main__":
    run_command(command, "python -m studies.blind")

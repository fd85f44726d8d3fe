# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.reproduce`."""

import os
from pathlib import Path

import click

from hmcvt_tools.cli.commands import run_command
from hmcvt_tools.cli.common import Progress, json_option, print_json

from .procedure import reproduce
from .report import write

_SEEDS = 30
_JOBS = 2


@click.command(
    "reproduce",
    epilog="""\b
Examples:
  python -m studies.reproduce
  python -m studies.reproduce --out reproduction --seeds 100
  python -m studies.reproduce --json""",
)
@click.option(
    "--out",
    default="reproduction",
    show_default=True,
    metavar="DIR",
    type=click.Path(file_okay=False, writable=True, path_type=Path),
    help="Folder for report.html, report.md and the figures.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 1000),
    default=_SEEDS,
    show_default=True,
    help="Runs of each algorithm of figure 6.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    default=min(_JOBS, os.cpu_count() or 1),
    show_default=f"cores, at most {_JOBS}",
    help="Processes side by side.",
)
@json_option
def command(out: Path, seeds: int, jobs: int, as_json: bool) -> None:
    """Put every number and figure of the paper beside ours, with a verdict on each."""
    progress = Progress("reproducing")
    try:
        found = reproduce(seeds, jobs, progress)
        progress("drawing")
        written = write(found, out, f"python -m studies.reproduce --seeds {seeds}")
    finally:
        progress.close()
    if as_json:
        print_json([item.to_dict() for item in found.items])
        return
    click.echo(written[1].read_text(encoding="utf-8"))
    click.echo(f"written to {' and '.join(map(str, written))}")


if __name__ == "__main__":
    run_command(command, "python -m studies.reproduce")

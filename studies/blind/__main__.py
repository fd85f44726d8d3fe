# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.blind`."""

import os
from pathlib import Path
from typing import Any

import click

from hmcvt_core.files.atomic import write_atomically
from hmcvt_tools.cli.commands import run_command
from hmcvt_tools.cli.common import OutputFile
from hmcvt_tools.fleet.executors import Processes
from studies.workers import recorded

from .bench.properties import PROPERTIES, Bench
from .bench.study import cases as bench_cases
from .bench.study import cost as bench_cost
from .bench.study import page as bench_page
from .bench.study import report as bench_report
from .bench.study import run as run_bench
from .bench.study import save
from .conditions import PARTS, cases
from .loop import work
from .renewed.judge import CHANNELS, EFFECTS, ERRORS
from .renewed.scores import limits_table
from .renewed.scores import report as renewed_report
from .renewed.study import cases as renewed_cases
from .renewed.study import page as renewed_page
from .renewed.study import paired, paired_table
from .renewed.study import run as run_renewed
from .scoring import goals, misses, report

ALL_ERRORS = "errors"
KEPT_BACK = 500_000_000  # seeds from here on are for the page alone


@click.command("blind")
@click.option(
    "--plant",
    type=click.Choice(["twin", "bench", "renewed"]),
    default="twin",
    show_default=True,
    help="The twin with plain readings, the bench with sessions, meters and texture, or the "
    "renewed plant with forms of its own and an oracle.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 900),
    default=12,
    show_default=True,
    help="Twin: campaigns per single effect at either noise.",
)
@click.option(
    "--seed-base",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help=f"Twin: first seed; those from {KEPT_BACK} on are kept back from development.",
)
@click.option(
    "--part",
    "parts",
    type=click.Choice(PARTS),
    multiple=True,
    default=PARTS,
    help="Twin: what to run; may be given more than once.  [default: all]",
)
@click.option(
    "--quick",
    is_flag=True,
    help="Twin: one campaign per effect at 0.4 %, or in the parts chosen: goals and misses.",
)
@click.option(
    "--only",
    default="",
    metavar="TEXT",
    help="Twin: only campaigns with this in their name, as pair in `0.4 %/pair/24001`.",
)
@click.option(
    "--campaigns",
    type=click.IntRange(1),
    default=24,
    show_default=True,
    help="Bench, renewed: number of campaigns.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=1,
    show_default=True,
    help="Bench, renewed: seed of the first campaign; kept back are those from 90000000 on of "
    "the bench and those from 97500000 on of the renewed plant.",
)
@click.option(
    "--without",
    type=click.Choice([*PROPERTIES, *CHANNELS, *ERRORS, ALL_ERRORS, *EFFECTS]),
    metavar="NAME",
    multiple=True,
    help="Bench: a property to switch off; renewed: a column, the errors of base, meters or both, "
    "or an effect of the library, to leave out and to compare with; may be given more than once.",
)
@click.option(
    "--kinds",
    default="",
    metavar="KIND,...",
    help="Bench, renewed: kinds of campaign, such as single,pair,nothing.  [default: all]",
)
@click.option(
    "--cost",
    is_flag=True,
    help="Bench: one run with each property switched off, on the same seeds.",
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
    help="Twin, renewed: to continue after an interruption.  [default of the twin: "
    "blind-results.jsonl, --quick none; of renewed: none]",
)
@click.option(
    "--out",
    type=OutputFile(),
    default=None,
    metavar="FILE",
    help="Twin: write the report there too. Bench, renewed: write the records there as JSON.",
)
@click.option(
    "--page",
    type=OutputFile(),
    default=None,
    metavar="FILE.md",
    help="Bench, renewed: write the section of the page there.",
)
def command(plant: str, jobs: int, out: str | None, **options: Any) -> None:
    """Run the blind trial: the diagnosis gets the bench columns of the campaigns alone."""
    runs = {"twin": _twin, "bench": _bench, "renewed": _renewed}
    click.echo(runs[plant](options, jobs, out))


def _bench(options: dict[str, Any], jobs: int, out: str | None) -> str:
    """Run campaigns on the bench; return their tables."""
    kinds = tuple(kind for kind in options["kinds"].split(",") if kind)

    def progress(line: str) -> None:
        click.echo(line, err=True)

    if options["cost"]:
        text, content = bench_cost(
            options["campaigns"], options["seed"], jobs, kinds, progress
        )
        if out is not None:
            save(Path(out), content)
        _write_page(options, content["nothing"], text)
        return text
    bench = Bench().without(*options["without"])
    todo = bench_cases(options["campaigns"], options["seed"], bench, kinds)
    records = run_bench(todo, jobs, progress)
    if out is not None:
        save(Path(out), records)
    _write_page(options, records)
    return bench_report(records)


def _renewed(options: dict[str, Any], jobs: int, out: str | None) -> str:
    """Run campaigns on the renewed plant; return their tables."""
    kinds = tuple(kind for kind in options["kinds"].split(",") if kind)
    path = Path(options["results"] or os.devnull)

    def progress(line: str) -> None:
        click.echo(line, err=True)

    campaigns, seed = options["campaigns"], options["seed"]
    records = run_renewed(renewed_cases(campaigns, seed, kinds), jobs, path, progress)
    text = renewed_report(records)
    fewer_errors = {}
    fewer_columns = {}
    fewer_effects = {}
    for name in options["without"]:
        names = ERRORS if name == ALL_ERRORS else (name,)
        todo = renewed_cases(campaigns, seed, kinds, names, oracle=False)
        others = run_renewed(todo, jobs, path, progress)
        if name in CHANNELS:
            fewer_columns[name] = paired(records, others, name)
        elif name in (*ERRORS, ALL_ERRORS):
            fewer_errors[name.replace("_", " ")] = others
        else:
            fewer_effects[name] = paired(records, others, name)
    if fewer_columns:
        text += "\n\n" + paired_table("column", fewer_columns)
    if fewer_effects:
        text += "\n\n" + paired_table("effect", fewer_effects)
    if fewer_errors:
        text += "\n\n" + limits_table(records, fewer_errors)
    if out is not None:
        save(Path(out), records)
    if options["page"] is not None:
        line = f"python -m studies.blind --plant renewed --campaigns {campaigns} --seed {seed}"
        if kinds:
            line += f" --kinds {options['kinds']}"
        write_atomically(Path(options["page"]), renewed_page(records, line, seed))
    return text


def _write_page(
    options: dict[str, Any], records: list[dict[str, Any]], cost_lines: str = ""
) -> None:
    """Write the section of the page, where it is asked for."""
    if options["page"] is None:
        return
    words = f"--campaigns {options['campaigns']} --seed {options['seed']}"
    if options["kinds"]:
        words += f" --kinds {options['kinds']}"
    for name in options["without"]:
        words += f" --without {name}"
    if cost_lines:
        words += " --cost"
    line = f"python -m studies.blind --plant bench {words}"
    text = bench_page(records, line, options["seed"], cost_lines)
    write_atomically(Path(options["page"]), text)


def _twin(options: dict[str, Any], jobs: int, out: str | None) -> str:
    """Run campaigns of the twin; return the report."""
    seeds = options["seeds"]
    seed_base = options["seed_base"]
    parts = options["parts"]
    quick = options["quick"]
    if quick:
        seeds = 1
        parts = parts if parts != PARTS else PARTS[:1]
    todo = {
        case.key: case
        for case in cases(seed_base, seeds, parts)
        if options["only"] in case.key
    }
    records: list[dict[str, Any]] = []
    with Processes(jobs) as pool:
        default = os.devnull if quick else "blind-results.jsonl"
        path = Path(options["results"] or default)
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
    return f"{goals(records)}\n\n{misses(records)}" if quick else text


if __name__ == "__main__":
    run_command(command, "python -m studies.blind")

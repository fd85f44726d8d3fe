# SPDX-License-Identifier: Apache-2.0
"""`hmcvt fleet`."""

from __future__ import annotations

import math
import os
import sys
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import click

from ..files.resources import data_path
from ..fleet.executors import Place, on_cluster, on_processes
from ..fleet.results import find_logs, locked
from ..fleet.run import Entry, run, split
from ..fleet.study import Settings
from ..fleet.summary import GAP, LEAST_LOGS, QUANTITIES, THRESHOLD, BrokenLog, Row, Summary
from ..model.parameter_file import load_model, load_stage
from ..physics.effects import Effect
from . import common

SOME_BROKEN = 3
"""Exit code when the work is done but some logs have no result."""

_REPORT_EVERY = 60.0  # seconds between lines on a stderr that is no terminal


@click.command("fleet", epilog="""\b
Examples:
  hmcvt fleet logs --out fitted
  hmcvt fleet logs --out fitted --processes 4 --noise 0.004 --json
  hmcvt fleet logs --out fitted --scheduler tcp://10.0.0.5:8786""")
@click.argument("logs", metavar="LOGS_DIR")
@click.option("--out", required=True, metavar="PARAMS_DIR",
              help="Folder for the parameter file and the result of each log.")
@click.option("--processes", type=click.IntRange(1, 1024), default=None, show_default="cores",
              help="Logs side by side on this machine.")
@click.option("--scheduler", default=None, metavar="ADDRESS",
              help="Work on the Dask cluster with this scheduler instead.")
@click.option("--no-diagnose", is_flag=True,
              help="Identify the parameters only; published needs it.")
@common.noise_option
@click.option("--params", default=None, metavar="P.yaml",
              help="Take gear train and effects from this parameter file.")
@common.model_options
@common.seed_option
@common.json_option
@click.pass_context
def command(
    ctx: click.Context, logs: str, out: str, processes: int | None, scheduler: str | None,
    no_diagnose: bool, noise: float | None, params: str | None, transmission: str | None,
    stage: str | None, gears: list[float], formulation: str, seed: int, as_json: bool,
) -> None:
    """Identify and diagnose every bench log (.csv) in a folder and the folders below it.

    Finished logs are skipped when the command is run again; a broken log does not stop the rest.
    """
    # Refused: options that would be ignored or contradict each other.
    if processes is not None and scheduler is not None:
        raise click.UsageError("--processes is for this machine, --scheduler for a cluster: "
                               "give one")
    if params is not None and (transmission is not None or stage is not None):
        raise click.UsageError("--params holds a gear train: leave --transmission and --stage out")
    if no_diagnose and noise is not None:
        raise click.UsageError("--noise is for the diagnosis, --no-diagnose leaves it out")
    if params is None:
        train = load_stage(transmission or data_path("params/transmission.yaml"), stage)
        effects: tuple[Effect, ...] = ()
    else:
        base = load_model(params)
        train, effects = base.stage, base.effects
    trains = tuple(train.with_gear_efficiency(value) for value in gears) or (train,)
    settings = Settings(trains, formulation, effects, not no_diagnose, noise, seed)
    # Cores that this process may use, which in a container are fewer than there are.
    place = (partial(on_processes, processes or len(os.sched_getaffinity(0)))
             if scheduler is None else partial(on_cluster, scheduler))
    found = _run(Path(logs), Path(out), settings, place)
    if as_json:
        common.print_json(found.to_dict())
    else:
        click.echo(_report(found))
    ctx.exit(SOME_BROKEN if found.broken else 0)


def _run(logs: Path, out: Path, settings: Settings, place: Place) -> Summary:
    # Before the folder for the results is made: a misspelt LOGS_DIR shall leave nothing behind.
    found = find_logs(logs, out)
    with locked(out):
        todo, done = split(found, settings)
        with closing(_Counter(len(todo))) as counter:
            entries = run(todo, settings, place, counter)
    return Summary.of(done, entries)


class _Counter:
    """Tells on stderr how far the fleet is, and at once which log is broken."""

    def __init__(self, logs: int) -> None:
        self.logs, self.finished, self.broken = logs, 0, 0
        self.start = self.told = time.monotonic()
        self.line = common.Progress("fleet")

    def __call__(self, entry: Entry) -> None:
        """Count a log."""
        if isinstance(entry, BrokenLog):
            self.broken += 1
            self.line.close()
            click.echo(f"hmcvt: broken: {entry.error}", err=True)
        else:
            self.finished += 1
        now = time.monotonic()
        if sys.stderr.isatty():
            self.line(self._text(now))
        elif now - self.told > _REPORT_EVERY:
            self.told = now
            click.echo(f"fleet: {self._text(now)}", err=True)

    def close(self) -> None:
        """Tell the rate reached."""
        self.line.close()
        if self.finished:
            seconds = time.monotonic() - self.start
            click.echo(f"fleet: {self.finished} logs finished in {seconds:.1f} s, "
                       f"{self.finished / seconds:.2f} logs/s", err=True)

    def _text(self, now: float) -> str:
        gone = self.finished + self.broken
        left = (now - self.start) / gone * (self.logs - gone)
        return (f"{gone} of {self.logs} logs, {self.broken} broken, "
                f"about {math.ceil(left / 60.0)} min left")


def _report(found: Summary) -> str:
    parts = []
    if found.rows:
        parts += [_rows(found), _fleet(found)]
    if found.broken:
        parts.append("\n".join(["broken", *(f"  {entry.error}" for entry in found.broken)]))
    parts.append(_counts(found))
    return "\n\n".join(parts)


def _rows(found: Summary) -> str:
    head = ("log", "leakage [m3/(s Pa)]", "motor damping [N m s/rad]", "pump damping [N m s/rad]",
            "gap [points]", "verdict", "leading cause", "outlier (z)")
    return common.table(head, [_row(row, found.outlying(place))
                               for place, row in enumerate(found.rows)])


def _row(row: Row, outlying: dict[str, float]) -> tuple[str, ...]:
    cause = "-" if row.cause is None else f"{row.cause} ({100 * (row.probability or 0.0):.0f} %)"
    apart = ", ".join(f"{name} {z:+.1f}" for name, z in outlying.items())
    values = row.values
    return (row.log, f"{values['leakage']:.3e}", f"{values['motor_damping']:.4f}",
            f"{values['pump_damping']:.4f}", common.number(100 * values.get(GAP, math.nan), ".2f"),
            row.verdict or "-", cause, apart or "-")


def _fleet(found: Summary) -> str:
    rows = []
    for name, scores in found.scores.items():
        factor, unit = (100.0, "points") if name == GAP else (1.0, QUANTITIES[name])
        rows.append((name, f"{factor * scores.median:.4g} {unit}",
                     f"{factor * scores.deviation:.3g} "
                     + ("decades" if scores.logarithmic else unit),
                     "yes" if math.isfinite(scores.z[0]) else "no"))
    return (common.table(("fleet", "median", "1.4826 MAD", "judged"), rows) + "\n"
            f"outlier: |z| > {THRESHOLD}, z = (value - median) / (1.4826 MAD), leakage by its "
            f"logarithm;\nnot judged: fewer than {LEAST_LOGS} logs, or at least half of them equal")


def _counts(found: Summary) -> str:
    counts = found.counts()
    lines = [f"{counts['logs']} logs: {counts['finished_now']} finished now, "
             f"{counts['finished_before']} before, {counts['broken']} broken; "
             f"{counts['outliers']} outliers"]
    for kind in ("verdicts", "causes"):
        if counts[kind]:
            lines.append(f"{kind}: " + ", ".join(f"{word} {count}"
                                                 for word, count in counts[kind].items()))
    return "\n".join(lines)

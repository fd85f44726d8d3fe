# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt fleet`."""

import math
import os
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import click

from ..fleet.executors import Processes, on_cluster
from ..fleet.run import Settings, run
from ..fleet.summary import GAP, MIN_LOGS, THRESHOLD, Entry
from . import common
from .common import Answer

SOME_BROKEN = 3
"""Exit code when the fleet is done but some logs are broken."""

REPORT_EVERY = 60.0
"""Seconds between lines of progress where stderr is no terminal [s]."""


@common.command(
    "fleet",
    """
  hmcvt fleet logs --out fitted
  hmcvt fleet logs --out fitted --processes 4 --noise 0.004 --json
  hmcvt fleet logs --out fitted --scheduler tcp://10.0.0.5:8786""",
    common.noise_option,
    common.model_options,
    common.effects_passed_on_option,
    common.seed_option,
)
@click.argument("logs", metavar="LOGS_DIR")
@click.option(
    "--out",
    required=True,
    metavar="PARAMS_DIR",
    help="Folder for the parameter file and the result of each log.",
)
@click.option(
    "--processes",
    type=click.IntRange(1, 1024),
    default=None,
    show_default="cores",
    help="Logs side by side on this machine.",
)
@click.option(
    "--scheduler",
    default=None,
    metavar="ADDRESS",
    help="Work on the Dask cluster with this scheduler instead.",
)
@click.option(
    "--no-diagnose",
    is_flag=True,
    help="Identify the parameters only; published needs it.",
)
@click.option(
    "--params",
    default=None,
    metavar="P.yaml",
    help="Take gear train and effects from this parameter file; of several stages each "
    "log has a column stage.",
)
def command(
    logs: str,
    out: str,
    processes: int | None,
    scheduler: str | None,
    no_diagnose: bool,
    noise: float | None,
    params: str | None,
    transmission: str | None,
    stage: str | None,
    effects: tuple[str, ...],
    gears: list[float],
    formulation: str,
    seed: int,
) -> Answer:
    """Identify and diagnose every bench log (.csv) in a folder and the folders below it.

    Finished logs are skipped when the command is run again; a broken log does not stop the rest.
    """
    common.one_of("say where to work", processes=processes, scheduler=scheduler)
    if no_diagnose and noise is not None:
        raise click.UsageError(
            "--noise is for the diagnosis, --no-diagnose leaves it out"
        )
    stages, fixed_effects = common.gear_train(params, transmission, stage)
    settings = Settings(
        stages=tuple(stages),
        formulation=formulation,
        effects=fixed_effects,
        diagnosed=not no_diagnose,
        noise=noise,
        seed=seed,
        gear_efficiencies=tuple(gears) or (None,),
        effect_sources=_absolute(effects),
    )
    executor: AbstractContextManager[Executor]
    if scheduler is None:  # noqa: SIM108 - two kinds of executor
        executor = Processes(processes or _cores())
    else:
        executor = on_cluster(scheduler)
    with _Counter("fleet", REPORT_EVERY) as counter:
        summary = run(Path(logs), Path(out), settings, executor, counter.count)
    code = SOME_BROKEN if summary["broken"] else 0
    return Answer(summary, [_report(summary)], code)


def _absolute(sources: tuple[str, ...]) -> tuple[str, ...]:
    """Return sources of effects that mean the same in a process started elsewhere."""
    absolute = []
    for source in sources:
        is_file = source.endswith(".py")
        absolute.append(str(Path(source).resolve()) if is_file else source)
    return tuple(absolute)


class _Counter(common.Progress):
    """Shows on stderr how far the fleet is, and each broken log at once."""

    finished = 0
    broken = 0

    def __enter__(self) -> "_Counter":
        return self

    def count(self, entry: Entry, logs: int) -> None:
        """Count one log.

        Args:
            entry: record of the log.
            logs: number of logs of this run.
        """
        if "error" in entry:
            self.broken += 1
            super().close()
            click.echo(f"hmcvt: broken: {entry['error']}", err=True)
        else:
            self.finished += 1
        done = self.finished + self.broken
        seconds_left = self.seconds() / done * (logs - done)
        self(
            f"{done} of {logs} logs, {self.broken} broken, "
            f"about {math.ceil(seconds_left / 60.0)} min left"
        )

    def close(self) -> None:
        """Show the rate reached."""
        super().close()
        if self.finished:
            seconds = self.seconds()
            click.echo(
                f"fleet: {self.finished} logs finished in {seconds:.1f} s, "
                f"{self.finished / seconds:.2f} logs/s",
                err=True,
            )


def _report(summary: dict[str, Any]) -> str:
    """Return the summary of a fleet as text."""
    parts = []
    if summary["logs"]:
        head = (
            "log",
            "leakage [m3/(s Pa)]",
            "motor damping [N m s/rad]",
            "pump damping [N m s/rad]",
            "gap [points]",
            "verdict",
            "leading cause",
            "outlier (z)",
        )
        parts.append(common.table(head, map(_row, summary["logs"])))
        parts.append(_quantity_table(summary["fleet"]))
    if summary["broken"]:
        lines = ["broken"]
        lines += [f"  {entry['error']}" for entry in summary["broken"]]
        parts.append("\n".join(lines))
    parts.append(_count_lines(summary["counts"]))
    return "\n\n".join(parts)


def _count_lines(counts: dict[str, Any]) -> str:
    lines = [
        f"{counts['logs']} logs: {counts['finished_now']} finished now, "
        f"{counts['finished_before']} before, {counts['broken']} broken; "
        f"{counts['outliers']} outliers"
    ]
    for kind in ("verdicts", "causes"):
        if counts[kind]:
            numbers = [f"{word} {count}" for word, count in counts[kind].items()]
            lines.append(f"{kind}: {', '.join(numbers)}")
    return "\n".join(lines)


def _row(log: Entry) -> tuple[str, ...]:
    """Return the cells of one log."""
    values = {name: entry["value"] for name, entry in log["parameters"].items()}
    cause = "-"
    if log["cause"] is not None:
        cause = f"{log['cause']} ({100 * log['probability']:.0f} %)"
    gap = "-"
    if log[GAP] is not None:
        gap = f"{100 * log[GAP]:.2f}"
    outlier = ", ".join(f"{name} {log['z'][name]:+.1f}" for name in log["outlier"])
    return (
        log["log"],
        f"{values['leakage']:.3e}",
        f"{values['motor_damping']:.4f}",
        f"{values['pump_damping']:.4f}",
        gap,
        log["verdict"] or "-",
        cause,
        outlier or "-",
    )


def _quantity_table(quantities: dict[str, dict[str, Any]]) -> str:
    """Return median and scatter of each quantity over the fleet."""
    rows = []
    for name, entry in quantities.items():
        factor = 1.0
        unit = entry["unit"]
        if name == GAP:
            factor = 100.0
            unit = "points"
        scatter_unit = "decades" if entry["scale"] == "log10" else unit
        rows.append(
            (
                name,
                f"{factor * entry['median']:.4g} {unit}",
                f"{factor * entry['deviation']:.3g} {scatter_unit}",
                "yes" if entry["judged"] else "no",
            )
        )
    return (
        common.table(("fleet", "median", "1.4826 MAD", "judged"), rows) + "\n"
        f"outlier: |z| > {THRESHOLD}, z = (value - median) / (1.4826 MAD), leakage by its "
        f"logarithm;\nnot judged: fewer than {MIN_LOGS} logs, or at least half of them equal"
    )


def _cores() -> int:
    """Return the cores that this process may use; a container may allow fewer than exist."""
    if hasattr(os, "sched_getaffinity"):  # Linux
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1

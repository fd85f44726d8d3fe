# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt fleet`."""

import math
import os
from pathlib import Path
from typing import Any

import click

from ..fleet.executors import Processes, on_cluster
from ..fleet.run import Settings, run
from ..fleet.summary import GAP, LEAST_LOGS, THRESHOLD, Entry
from . import common
from .common import Answer

_SOME_BROKEN = 3  # exit code
_REPORT_EVERY = 60.0  # seconds between lines on a stderr that is no terminal


@common.command(
    "fleet",
    """
  hmcvt fleet logs --out fitted
  hmcvt fleet logs --out fitted --processes 4 --noise 0.004 --json
  hmcvt fleet logs --out fitted --scheduler tcp://10.0.0.5:8786""",
    common.noise_option,
    common.model_options,
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
    gears: list[float],
    formulation: str,
    seed: int,
) -> Answer:
    """Identify and diagnose every bench log (.csv) in a folder and the folders below it.

    Finished logs are skipped when the command is run again; a broken log does not stop the rest.
    """
    # Refused: options that would be ignored or contradict each other.
    common.one_of("say where to work", processes=processes, scheduler=scheduler)
    if no_diagnose and noise is not None:
        raise click.UsageError(
            "--noise is for the diagnosis, --no-diagnose leaves it out"
        )
    stages, effects = common.gear_train(params, transmission, stage)
    settings = Settings(
        tuple(stages),
        formulation,
        effects,
        not no_diagnose,
        noise,
        seed,
        tuple(gears) or (None,),
    )
    place = (
        Processes(processes or _cores()) if scheduler is None else on_cluster(scheduler)
    )
    counter = _Counter("fleet", _REPORT_EVERY)
    with counter:
        found = run(Path(logs), Path(out), settings, place, counter.count)
    return Answer(found, [_report(found)], _SOME_BROKEN if found["broken"] else 0)


class _Counter(common.Progress):
    """Tells on stderr how far the fleet is, and at once which log is broken."""

    finished = broken = 0

    def count(self, entry: Entry, logs: int) -> None:
        """Count one of so many logs."""
        if "error" in entry:
            self.broken += 1
            super().close()
            click.echo(f"hmcvt: broken: {entry['error']}", err=True)
        else:
            self.finished += 1
        gone = self.finished + self.broken
        left = self.seconds() / gone * (logs - gone)
        self(
            f"{gone} of {logs} logs, {self.broken} broken, "
            f"about {math.ceil(left / 60.0)} min left"
        )

    def close(self) -> None:
        """Tell the rate reached."""
        super().close()
        if self.finished:
            seconds = self.seconds()
            click.echo(
                f"fleet: {self.finished} logs finished in {seconds:.1f} s, "
                f"{self.finished / seconds:.2f} logs/s",
                err=True,
            )


def _report(found: dict[str, Any]) -> str:
    parts = []
    if found["logs"]:
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
        parts += [common.table(head, map(_row, found["logs"])), _fleet(found["fleet"])]
    if found["broken"]:
        parts.append(
            "\n".join(["broken", *(f"  {entry['error']}" for entry in found["broken"])])
        )
    counts = found["counts"]
    lines = [
        f"{counts['logs']} logs: {counts['finished_now']} finished now, "
        f"{counts['finished_before']} before, {counts['broken']} broken; "
        f"{counts['outliers']} outliers"
    ]
    lines += [
        f"{kind}: "
        + ", ".join(f"{word} {count}" for word, count in counts[kind].items())
        for kind in ("verdicts", "causes")
        if counts[kind]
    ]
    return "\n\n".join([*parts, "\n".join(lines)])


def _row(log: Entry) -> tuple[str, ...]:
    cause = (
        "-"
        if log["cause"] is None
        else f"{log['cause']} ({100 * log['probability']:.0f} %)"
    )
    leakage, *dampings = (entry["value"] for entry in log["parameters"].values())
    return (
        log["log"],
        f"{leakage:.3e}",
        *(f"{damping:.4f}" for damping in dampings),
        "-" if log[GAP] is None else f"{100 * log[GAP]:.2f}",
        log["verdict"] or "-",
        cause,
        ", ".join(f"{name} {log['z'][name]:+.1f}" for name in log["outlier"]) or "-",
    )


def _fleet(quantities: dict[str, dict[str, Any]]) -> str:
    rows = []
    for name, entry in quantities.items():
        factor, unit = (100.0, "points") if name == GAP else (1.0, entry["unit"])
        scatter = "decades" if entry["scale"] == "log10" else unit
        rows.append(
            (
                name,
                f"{factor * entry['median']:.4g} {unit}",
                f"{factor * entry['deviation']:.3g} {scatter}",
                "yes" if entry["judged"] else "no",
            )
        )
    return (
        common.table(("fleet", "median", "1.4826 MAD", "judged"), rows) + "\n"
        f"outlier: |z| > {THRESHOLD}, z = (value - median) / (1.4826 MAD), leakage by its "
        f"logarithm;\nnot judged: fewer than {LEAST_LOGS} logs, or at least half of them equal"
    )


def _cores() -> int:
    """Cores that this process may use, which in a container are fewer than there are."""
    if hasattr(os, "sched_getaffinity"):  # Linux
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1

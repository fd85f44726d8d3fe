# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.real [DIR]`: rigs with known faults and makers' units, failures first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from hmcvt_core.files.atomic import write_atomically
from studies.blind.bench.scores import WORSE
from studies.page import Goal, goal_table, render, table
from studies.units.judge import units_of

from .judge import (
    HALVES,
    MIN_BAND_REMOVED,
    BandRun,
    Run,
    bands,
    leak_by_coolers,
    leak_by_settings,
    poor_coolers,
    sound_halves,
)
from .rig import is_rig, read_rig

SHIPPED = Path(__file__).parents[2] / "data" / "real"
"""Tables that are judged unless another folder is given."""
PARTS_BY_SETTING = 10.0 / 12.0
"""Fraction of the settings at which the part and the form of the leak have to be right."""


@click.command("real")
@click.argument(
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    default=SHIPPED,
)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(folder: Path, out: Path | None) -> None:
    """Judge every rig and every unit of FOLDER, or of data/real."""
    runs: list[Run] = []
    band_runs: list[BandRun] = []
    for path in sorted(folder.glob("*.csv")):
        click.echo(path.name, err=True)
        if is_rig(path):
            runs += _runs_of_rig(path)
            continue
        for name, samples in units_of(path).items():
            band_runs += bands(name, samples)
    page = written(runs, band_runs)
    click.echo(page)
    if out is not None:
        write_atomically(out, page)


def _runs_of_rig(path: Path) -> list[Run]:
    rig = read_rig(path)
    runs = []
    for with_temperature in (True, False):
        runs += sound_halves(rig, with_temperature)
        runs += poor_coolers(rig, with_temperature)
    for fault in sorted(set(rig.fault.tolist()) - {0.0}):
        runs += leak_by_coolers(rig, fault)
        runs += leak_by_settings(rig, fault)
    return runs


def written(runs: Sequence[Run], band_runs: Sequence[BandRun]) -> str:
    """Return the page."""
    return render(
        "real.md.j2",
        Path(__file__).parent,
        goals=goal_table([*_rig_goals(runs), *_band_goals(band_runs)]),
        wrong=_run_table([run for run in runs if not run.right]),
        bands=_band_table(band_runs),
        halves=HALVES,
    )


def _rig_goals(runs: Sequence[Run]) -> list[Goal]:
    goals = []
    kinds = dict.fromkeys(run.kind for run in runs)
    for kind in kinds:
        of_kind = [run for run in runs if run.kind == kind]
        right = sum(run.right for run in of_kind)
        least = len(of_kind)
        if kind.startswith("sound half"):
            least -= 1
        elif kind == "leak by setting":
            least = int(np.ceil(PARTS_BY_SETTING * len(of_kind)))
        goals.append(
            Goal(
                f"{kind}: right",
                f">= {least} of {len(of_kind)}",
                f"{right} of {len(of_kind)}",
                right >= least,
            )
        )
    return goals


def _band_goals(band_runs: Sequence[BandRun]) -> list[Goal]:
    if not band_runs:
        return []
    goals = []
    for channel in ("flow", "torque"):
        of_channel = [run.removed for run in band_runs if run.channel == channel]
        if not of_channel:
            continue
        middle = float(np.median(of_channel))
        goals.append(
            Goal(
                f"makers' units, bands held out, {channel}: part of the gap removed, median",
                f">= {100 * MIN_BAND_REMOVED:.0f} %",
                f"{100 * middle:.0f} %",
                middle >= MIN_BAND_REMOVED,
            )
        )
    worse = sum(run.served > WORSE * run.base for run in band_runs)
    goals.append(
        Goal(
            "the same: error more than 2 % above that of the paper's terms",
            "none",
            f"{worse} of {len(band_runs)}",
            worse == 0,
        )
    )
    points = sum(run.points for run in band_runs)
    inside = sum(run.inside for run in band_runs) / max(points, 1)
    goals.append(
        Goal(
            "the same: samples inside the 95 % interval of the saved model",
            "85 to 99 %",
            f"{100 * inside:.0f} % of {points}",
            0.85 <= inside <= 0.99,
        )
    )
    return goals


def _run_table(runs: Sequence[Run]) -> str:
    rows = []
    for run in runs:
        removed = "-" if np.isnan(run.removed) else f"{100 * run.removed:.0f} %"
        verdict = run.verdict.replace("_", " ")
        rows.append((run.kind, run.what, verdict, run.part, run.leading, removed))
    head = ("comparison", "windows", "verdict", "part", "leading set", "removed")
    return table(head, rows) if rows else "None."


def _band_table(band_runs: Sequence[BandRun]) -> str:
    rows = []
    for run in sorted(band_runs, key=lambda item: item.removed):
        rows.append(
            (
                run.unit,
                f"{run.side} {run.axis}",
                run.channel,
                f"{run.base:.3g}",
                f"{run.served:.3g}",
                f"{round(100 * run.removed)} %",
                f"{run.inside} of {run.points}",
                run.leading,
            )
        )
    head = (
        "unit",
        "held out",
        "channel",
        "paper's terms",
        "saved model",
        "removed",
        "inside 95 %",
        "leading set",
    )
    return table(head, rows)


if __name__ == "__main__":
    command()

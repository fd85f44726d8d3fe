# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt map`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np

from ..errors import InputError
from ..files.atomic import write_atomically
from ..files.bench import read_bench
from ..files.table import csv_text
from ..model.domain import AXES
from ..model.engine import load_engine
from ..model.model import EfficiencyModel
from ..report.pictures import draw_drive_line, draw_surface, save
from ..transmission.ranges import (
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OUTPUT_SPEED,
    RPM,
)
from . import common
from .common import Answer

_MOST_POINTS = 2_000_000
_PICTURE_POWER, _DRIVE_POWER = 40_000.0, 100_000.0


@common.command(
    "map",
    """
  hmcvt map --out map.csv
  hmcvt map --steps 21 11 5 --load-torque-limits 100 400 --json
  hmcvt map --picture map.png --power 23kW --bench data/table2.csv
  hmcvt map --params params/tractor.yaml --output-speed 350 --engine params/engine.yaml \\
            --out drive.csv --picture drive.png""",
    common.picture_option,
    common.stage_option,
    common.params_option,
)
@click.option(
    "--steps",
    type=click.IntRange(1, 1001),
    nargs=3,
    default=(41, 15, 8),
    show_default=True,
    help="Points over displacement ratio, engine speed, load torque.",
)
@click.option(
    "--engine-speed-limits",
    type=common.speed,
    nargs=2,
    default=ENGINE_SPEED_LIMITS,
    help="Lowest and highest.  [default: 750rpm 2200rpm]",
)
@click.option(
    "--load-torque-limits",
    type=float,
    nargs=2,
    default=(50.0, 400.0),
    show_default=True,
    help="Lowest and highest in N m.",
)
@click.option(
    "--out",
    type=common.OutputFile(),
    metavar="MAP.csv",
    help="Write CSV there, not to stdout.",
)
@click.option(
    "--power",
    type=common.power,
    help="Output power of the picture, in W or like 40kW.  [default: 40kW; of the "
    "drive line the highest, 100kW]",
)
@click.option(
    "--output-speed",
    type=common.speed,
    help="The map of the drive line instead: stage, engine speed, displacement ratio and "
    "fuel over output speeds up to this, and powers; --steps has its first two.",
)
@click.option(
    "--engine",
    metavar="ENGINE.yaml",
    help="Of the drive line: full-load curve and fuel map.",
)
@click.option(
    "--bench", metavar="BENCH.csv", help="Bench tests to mark in the picture."
)
def command(
    steps: tuple[int, int, int],
    engine_speed_limits: tuple[float, float],
    load_torque_limits: tuple[float, float],
    out: str | None,
    picture: str | None,
    power: float | None,
    bench: str | None,
    stage: str | None,
    params: str | None,
    output_speed: float | None,
    engine: str | None,
) -> Answer:
    """Write the efficiency over displacement ratio, engine speed and load torque.

    The picture shows it over engine speed and output speed / engine speed at one output power.
    With --output-speed: the best working points of the drive line over output speed and power.
    """
    common.keep_inputs([bench, params, engine], [out, picture])
    if output_speed is not None:
        if stage is not None or bench is not None:
            raise click.UsageError(
                "--stage and --bench are not of the drive line: leave out "
                "--output-speed"
            )
        OUTPUT_SPEED.check(output_speed, "--output-speed")
        return _drive_line(
            common.model_from(params),
            engine,
            (output_speed, power or _DRIVE_POWER),
            steps[:2],
            engine_speed_limits,
            out,
            picture,
        )
    if engine is not None:
        raise click.UsageError(
            "--engine is of the drive line: --output-speed is needed"
        )
    if picture is None and (bench is not None or power is not None):
        raise click.UsageError(
            "--power and --bench are of a picture: --picture is needed"
        )
    points = math.prod(steps)
    if points > _MOST_POINTS:
        raise InputError(f"--steps gives {points} points; at most {_MOST_POINTS}")
    # Before the grid is made: NumPy would warn of infinity rather than refuse it.
    ENGINE_SPEED.check(engine_speed_limits, "--engine-speed-limits")
    LOAD_TORQUE.check(load_torque_limits, "--load-torque-limits")
    model = common.stage_from(params, stage)
    common.note_oil_temperature(model)
    if picture is not None:
        samples = None if bench is None else read_bench(bench)
        shown = _PICTURE_POWER if power is None else power
        for speed in engine_speed_limits:
            if not LOAD_TORQUE.contains(shown / speed):
                raise InputError(
                    f"--power {1e-3 * shown:g}kW at {speed / RPM:.0f} r/min is a load "
                    f"torque of {shown / speed:.4g} N m; allowed {LOAD_TORQUE}"
                )
        save(draw_surface, picture, model, shown, engine_speed_limits, samples)
    found = model.efficiency_map(
        np.linspace(-1.0, 1.0, steps[0]),
        np.linspace(*engine_speed_limits, steps[1]),
        np.linspace(*load_torque_limits, steps[2]),
    )
    value = asdict(found)
    columns = {
        name: [f"{each:.6g}" for each in grid.ravel()]
        for name, grid in zip(
            AXES,
            np.meshgrid(*(value[axis] for axis in AXES), indexing="ij"),
            strict=True,
        )
    }
    # An empty cell: the load cannot be carried there.
    columns["efficiency"] = [
        f"{each:.6f}" if np.isfinite(each) else "" for each in found.efficiency.ravel()
    ]
    columns["inside_domain"] = (
        [""] * points
        if found.inside_domain is None
        else [str(each).lower() for each in found.inside_domain.ravel()]
    )
    return _written(value, columns, out, picture)


def _drive_line(
    model: EfficiencyModel,
    engine: str | None,
    highest: tuple[float, float],
    steps: tuple[int, int],
    limits: tuple[float, float],
    out: str | None,
    picture: str | None,
) -> Answer:
    """Best working points over output speeds and powers up to the highest."""
    with_engine = None if engine is None else load_engine(engine)
    speeds, powers = (
        np.linspace(top / count, top, count)
        for top, count in zip(highest, steps, strict=True)
    )
    best = [
        [
            model.optimal_drive(
                speed, power, engine=with_engine, engine_speed_limits=limits
            )
            for speed in speeds.tolist()
        ]
        for power in powers.tolist()
    ]
    if picture is not None:
        save(draw_drive_line, picture, speeds, powers, best)
    rows = [
        {"output_speed": speed, "output_power": power, **asdict(point)}
        for power, row in zip(powers.tolist(), best, strict=True)
        for speed, point in zip(speeds.tolist(), row, strict=True)
    ]
    # An empty cell: nothing holds the demand there.
    return _written(
        rows,
        {
            name: ["" if row[name] != row[name] else row[name] for row in rows]
            for name in rows[0]
        },
        out,
        picture,
    )


def _written(
    value: Any,
    columns: Mapping[str, Sequence[Any]],
    out: str | None,
    picture: str | None,
) -> Answer:
    """Write a map as CSV, or say where its picture is, or show the CSV."""
    if out is None and picture is not None:
        return Answer(value, [f"written to {picture}"])
    text = csv_text(columns)
    if out is None:
        return Answer(value, [text.rstrip("\n")])
    write_atomically(Path(out), text)
    return Answer(value)

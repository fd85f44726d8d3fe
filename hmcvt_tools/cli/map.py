# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt map`."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import read_bench
from hmcvt_core.files.table import csv_text
from hmcvt_core.model.domain import AXES
from hmcvt_core.model.engine import load_engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.optimum import DriveOptimum
from hmcvt_core.transmission.ranges import (
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    LOAD_TORQUE,
    OUTPUT_SPEED,
    RPM,
)

from ..report.drive_line import draw_drive_line
from ..report.pictures import draw_surface, save
from . import common
from .common import Answer

MAX_POINTS = 2_000_000
"""Points of a map: more would not fit into the memory of a small machine."""

PICTURE_POWER = 40_000.0
"""Output power of the picture of one stage when none is given [W]."""

DRIVE_POWER = 100_000.0
"""Highest output power of the drive line when none is given [W]."""


class _Output(NamedTuple):
    """Files that the command writes, None where left out."""

    table: str | None
    picture: str | None


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
    output = _Output(out, picture)
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
            np.linspace(output_speed / steps[0], output_speed, steps[0]),
            _powers(power or DRIVE_POWER, steps[1]),
            engine_speed_limits,
            output,
        )
    if engine is not None:
        raise click.UsageError(
            "--engine is of the drive line: --output-speed is needed"
        )
    if picture is None and (bench is not None or power is not None):
        raise click.UsageError(
            "--power and --bench are of a picture: --picture is needed"
        )
    if math.prod(steps) > MAX_POINTS:
        raise InputError(
            f"--steps gives {math.prod(steps)} points; at most {MAX_POINTS}"
        )
    # Checked before the grid is made: NumPy would only warn of infinity.
    ENGINE_SPEED.check(engine_speed_limits, "--engine-speed-limits")
    LOAD_TORQUE.check(load_torque_limits, "--load-torque-limits")
    model = common.stage_from(params, stage)
    common.note_oil_temperature(model)
    if picture is not None:
        shown_power = PICTURE_POWER if power is None else power
        _check_power(shown_power, engine_speed_limits)
        samples = None if bench is None else read_bench(bench)
        save(draw_surface, picture, model, shown_power, engine_speed_limits, samples)
    return _one_stage(
        model,
        np.linspace(-1.0, 1.0, steps[0]),
        np.linspace(*engine_speed_limits, steps[1]),
        np.linspace(*load_torque_limits, steps[2]),
        output,
    )


def _powers(highest: float, count: int) -> Any:
    return np.linspace(highest / count, highest, count)


def _check_power(power: float, engine_speed_limits: tuple[float, float]) -> None:
    for speed in engine_speed_limits:
        if not LOAD_TORQUE.contains(power / speed):
            raise InputError(
                f"--power {1e-3 * power:g}kW at {speed / RPM:.0f} r/min is a load "
                f"torque of {power / speed:.4g} N m; allowed {LOAD_TORQUE}"
            )


def _one_stage(
    model: EfficiencyModel, strokes: Any, speeds: Any, loads: Any, output: _Output
) -> Answer:
    """Compute and write the efficiency map of one stage."""
    grid = model.efficiency_map(strokes, speeds, loads)
    value = asdict(grid)
    coordinates = np.meshgrid(*(value[axis] for axis in AXES), indexing="ij")
    columns = {}
    for name, values in zip(AXES, coordinates, strict=True):
        columns[name] = [f"{number:.6g}" for number in values.ravel()]
    # The cell is empty where the load cannot be carried.
    efficiencies = []
    for efficiency in grid.efficiency.ravel():
        efficiencies.append(f"{efficiency:.6f}" if np.isfinite(efficiency) else "")
    columns["efficiency"] = efficiencies
    if grid.inside_domain is None:
        columns["inside_domain"] = [""] * len(efficiencies)
    else:
        columns["inside_domain"] = [
            str(inside).lower() for inside in grid.inside_domain.ravel()
        ]
    return _written(value, columns, output)


def _drive_line(
    model: EfficiencyModel,
    engine_path: str | None,
    speeds: Any,
    powers: Any,
    engine_speed_limits: tuple[float, float],
    output: _Output,
) -> Answer:
    """Compute and write the best working points over output speeds and powers."""
    engine = None if engine_path is None else load_engine(engine_path)
    common.note_oil_temperature(model)
    best: list[list[DriveOptimum]] = []
    rows = []
    for power in powers.tolist():
        line = []
        for speed in speeds.tolist():
            optimum = model.optimal_drive(
                speed, power, engine=engine, engine_speed_limits=engine_speed_limits
            )
            line.append(optimum)
            rows.append(
                {"output_speed": speed, "output_power": power, **asdict(optimum)}
            )
        best.append(line)
    if output.picture is not None:
        save(draw_drive_line, output.picture, speeds, powers, best, model, engine)
    # A cell is empty where nothing holds the demand.
    columns = {}
    for name in rows[0]:
        columns[name] = [_cell(row[name]) for row in rows]
    return _written(rows, columns, output)


def _cell(value: Any) -> Any:
    is_missing = isinstance(value, float) and math.isnan(value)
    return "" if is_missing else value


def _written(
    value: Any, columns: Mapping[str, Sequence[Any]], output: _Output
) -> Answer:
    """Write a map as CSV; without a file for it, print the CSV unless there is a picture."""
    if output.table is None and output.picture is not None:
        return Answer(value, [f"written to {output.picture}"])
    text = csv_text(columns)
    if output.table is None:
        return Answer(value, [text.rstrip("\n")])
    write_atomically(Path(output.table), text)
    lines = [f"written to {output.table}"]
    if output.picture is not None:
        lines.append(f"written to {output.picture}")
    return Answer(value, lines)

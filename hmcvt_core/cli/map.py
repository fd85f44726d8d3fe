# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt map`."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np

from ..errors import InputError
from ..files import plain
from ..files.atomic import write_atomically
from ..files.bench import read_bench
from ..model.domain import EfficiencyMap
from ..model.engine import load_engine
from ..model.model import EfficiencyModel
from ..transmission.ranges import ENGINE_SPEED, ENGINE_SPEED_LIMITS, LOAD_TORQUE, RPM
from . import common
from .quantities import power as power_type
from .quantities import speed, stage_option

_MOST_POINTS = 2_000_000
_PICTURE_POWER = 40_000.0
_GRID = 48, 30  # of the drive line


@click.command("map", epilog="""\b
Examples:
  hmcvt map --out map.csv
  hmcvt map --steps 21 11 5 --load-torque-limits 100 400 --json
  hmcvt map --picture map.png --power 40kW --bench data/table2.csv
  hmcvt map --drive-line 300 --power 90kW --params params/tractor.yaml \\
            --engine params/engine.yaml --picture drive.png --out drive.csv""")
@click.option("--steps", type=click.IntRange(1, 1001), nargs=3, default=(41, 15, 8),
              show_default=True, help="Points over displacement ratio, engine speed, load torque.")
@click.option("--engine-speed-limits", type=speed, nargs=2, default=ENGINE_SPEED_LIMITS,
              help="Lowest and highest.  [default: 750rpm 2200rpm]")
@click.option("--load-torque-limits", type=float, nargs=2, default=(50.0, 400.0),
              show_default=True, help="Lowest and highest in N m.")
@click.option("--out", type=common.OutputFile(), metavar="MAP.csv",
              help="Write CSV there, not to stdout.")
@common.picture_option
@click.option("--power", type=power_type,
              help="Output power of the picture, in W or like 40kW.  [default: 40kW]")
@click.option("--bench", metavar="BENCH.csv", help="Bench tests to mark in the picture.")
@click.option("--drive-line", type=click.FloatRange(min=1.0), metavar="OUTPUT_SPEED",
              help="Map the optimum of the drive line up to this output speed in rad/s, and up to "
                   "--power, with --engine; stages, engine speeds and fuel.")
@click.option("--engine", metavar="ENGINE.yaml", help="Of the drive line.")
@stage_option
@common.params_option
@common.json_option
def command(
    steps: tuple[int, int, int], engine_speed_limits: tuple[float, float],
    load_torque_limits: tuple[float, float], out: str | None, picture: str | None,
    power: float | None, bench: str | None, stage: str | None, params: str | None,
    as_json: bool, drive_line: float | None, engine: str | None,
) -> None:
    """Write the efficiency over displacement ratio, engine speed and load torque.

    The picture shows it over engine speed and output speed / engine speed at one output power.
    """
    if drive_line is not None:
        _drive_line(common.model_from(params), drive_line, power or 100e3, engine, out, picture,
                    as_json)
        return
    if picture is None and (bench is not None or power is not None):
        raise click.UsageError("--power and --bench are of a picture: --picture is needed")
    common.keep_inputs([bench, params], [out, picture])
    points = math.prod(steps)
    if points > _MOST_POINTS:
        raise InputError(f"--steps gives {points} points; at most {_MOST_POINTS}")
    # Before the grid is made: NumPy would warn of infinity rather than refuse it.
    ENGINE_SPEED.check(engine_speed_limits, "--engine-speed-limits")
    LOAD_TORQUE.check(load_torque_limits, "--load-torque-limits")
    model = common.stage_from(params, stage)
    common.note_oil_temperature(model)
    if picture is not None:
        from ..report import draw_surface, save

        samples = None if bench is None else read_bench(bench)
        shown = _PICTURE_POWER if power is None else power
        for end in engine_speed_limits:
            if not LOAD_TORQUE.contains(shown / end):
                raise InputError(f"--power {1e-3 * shown:g}kW at {end / RPM:.0f} r/min is a load "
                                 f"torque of {shown / end:.4g} N m; allowed {LOAD_TORQUE}")
        save(lambda figure: draw_surface(figure, model, shown, engine_speed_limits, samples),
             picture)
        if out is None and not as_json:
            click.echo(f"written to {picture}")
            return
    found = model.efficiency_map(
        np.linspace(-1.0, 1.0, steps[0]), np.linspace(*engine_speed_limits, steps[1]),
        np.linspace(*load_torque_limits, steps[2]))
    if out is not None:
        write_atomically(Path(out), _csv(found))
    if as_json:
        common.print_json({"displacement_ratio": found.displacement_ratio,
                           "engine_speed": found.engine_speed, "load_torque": found.load_torque,
                           "efficiency": found.efficiency, "inside_domain": found.inside_domain})
    elif out is None:
        click.echo(_csv(found), nl=False)


def _drive_line(
    model: EfficiencyModel, highest: float, power: float, engine: str | None, out: str | None,
    picture: str | None, as_json: bool,
) -> None:
    """Write the best working points over output speed and power."""
    common.keep_inputs([engine], [out, picture])
    known = None if engine is None else load_engine(engine)
    speeds, powers = (np.linspace(top / count, top, count)
                      for top, count in ((highest, _GRID[0]), (power, _GRID[1])))
    best = [[model.optimal_drive(float(x), float(y), engine=known) for y in powers]
            for x in speeds]
    rows = [{"output_speed": x, "output_power": y, **asdict(best[i][j])}
            for i, x in enumerate(speeds.tolist()) for j, y in enumerate(powers.tolist())]
    text = "\n".join([",".join(rows[0]), *(
        ",".join("" if value is None else str(value) for value in plain(row).values())
        for row in rows)]) + "\n"
    if picture is not None:
        from ..report import save
        from ..report.drive_map import draw_drive_map

        save(lambda figure: draw_drive_map(figure, speeds, powers, best, list(model.stages)),
             picture)
    if out is not None:
        write_atomically(Path(out), text)
    if as_json:
        common.print_json(rows)
    elif out is None:
        click.echo(text if picture is None else f"written to {picture}\n", nl=False)


def _csv(found: EfficiencyMap) -> str:
    lines = ["displacement_ratio,engine_speed,load_torque,efficiency,inside_domain"]
    inside = found.inside_domain
    for i, j, k in np.ndindex(found.efficiency.shape):
        # An empty cell: the load cannot be carried there.
        value = found.efficiency[i, j, k]
        lines.append(f"{found.displacement_ratio[i]:.6g},{found.engine_speed[j]:.6g},"
                     f"{found.load_torque[k]:.6g},"
                     + (f"{value:.6f}," if np.isfinite(value) else ",")
                     + ("" if inside is None else str(inside[i, j, k]).lower()))
    return "\n".join(lines) + "\n"

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt map`."""

from __future__ import annotations

import math
from pathlib import Path

import click
import numpy as np

from ..errors import InputError
from ..files.atomic import write_atomically
from ..files.bench import read_bench
from ..model.domain import EfficiencyMap
from ..transmission.ranges import ENGINE_SPEED, ENGINE_SPEED_LIMITS, LOAD_TORQUE, RPM
from . import common

_MOST_POINTS = 2_000_000
_PICTURE_POWER = 40_000.0


@click.command("map", epilog="""\b
Examples:
  hmcvt map --out map.csv
  hmcvt map --steps 21 11 5 --load-torque-limits 100 400 --json
  hmcvt map --picture map.png --power 40kW --bench data/table2.csv""")
@click.option("--steps", type=click.IntRange(1, 1001), nargs=3, default=(41, 15, 8),
              show_default=True, help="Points over displacement ratio, engine speed, load torque.")
@click.option("--engine-speed-limits", type=common.speed, nargs=2, default=ENGINE_SPEED_LIMITS,
              help="Lowest and highest.  [default: 750rpm 2200rpm]")
@click.option("--load-torque-limits", type=float, nargs=2, default=(50.0, 400.0),
              show_default=True, help="Lowest and highest in N m.")
@click.option("--out", type=common.OutputFile(), metavar="MAP.csv",
              help="Write CSV there, not to stdout.")
@common.picture_option
@click.option("--power", type=common.power,
              help="Output power of the picture, in W or like 40kW.  [default: 40kW]")
@click.option("--bench", metavar="BENCH.csv", help="Bench tests to mark in the picture.")
@common.stage_option
@common.params_option
@common.json_option
def command(
    steps: tuple[int, int, int], engine_speed_limits: tuple[float, float],
    load_torque_limits: tuple[float, float], out: str | None, picture: str | None,
    power: float | None, bench: str | None, stage: str | None, params: str | None,
    as_json: bool,
) -> None:
    """Write the efficiency over displacement ratio, engine speed and load torque.

    The picture shows it over engine speed and output speed / engine speed at one output power.
    """
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
        for speed in engine_speed_limits:
            if not LOAD_TORQUE.contains(shown / speed):
                raise InputError(f"--power {1e-3 * shown:g}kW at {speed / RPM:.0f} r/min is a load "
                                 f"torque of {shown / speed:.4g} N m; allowed {LOAD_TORQUE}")
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

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt optimum`."""

from __future__ import annotations

import math
from dataclasses import asdict

import click

from ..errors import HmcvtError
from ..model.optimum import HOLDS
from ..transmission.ranges import ENGINE_SPEED_LIMITS, RPM
from . import common


@click.command("optimum", epilog="""\b
Examples:
  hmcvt optimum --engine-speed 1400rpm --load-torque 200
  hmcvt optimum --engine-speed 2000rpm --load-torque 200 --hold output_speed \\
                --displacement-ratio -0.8
  hmcvt optimum --engine-speed 2000rpm --load-torque 200 --hold output_speed \\
                --output-speed 1250rpm --engine-speed-limits 900rpm 2100rpm --json""")
@click.option("--engine-speed", type=common.speed, required=True, help="Now: rad/s or 1400rpm.")
@click.option("--load-torque", type=float, required=True,
              help="Now: output power / engine speed in N m.")
@click.option("--hold", type=click.Choice(HOLDS), default="engine_speed", show_default=True,
              help="What must stay; output_speed looks for the best engine speed too.")
@click.option("--displacement-ratio", type=float,
              help="Now; tells the output speed to hold and what there is to gain.")
@click.option("--output-speed", type=common.speed, help="To hold: rad/s or 1400rpm.")
@click.option("--engine-speed-limits", type=common.speed, nargs=2,
              help="Lowest and highest engine speed.  [default: 750rpm 2200rpm]")
@common.params_option
@common.json_option
def command(
    engine_speed: float, load_torque: float, hold: str, displacement_ratio: float | None,
    output_speed: float | None, engine_speed_limits: tuple[float, float] | None,
    params: str | None, as_json: bool,
) -> None:
    """Find the displacement ratio that wastes least."""
    # Refused: options that would be ignored or contradict each other.
    if hold == "engine_speed" and (output_speed is not None or engine_speed_limits is not None):
        raise click.UsageError(
            "--output-speed and --engine-speed-limits need --hold output_speed")
    if displacement_ratio is not None and output_speed is not None:
        raise click.UsageError("--displacement-ratio (now) and --output-speed both tell the "
                               "output speed to hold: give one")
    model = common.model_from(params).without_meters()
    best = model.optimal_displacement_ratio(
        engine_speed, load_torque, hold=hold, displacement_ratio=displacement_ratio,
        output_speed=output_speed, engine_speed_limits=engine_speed_limits or ENGINE_SPEED_LIMITS)
    if math.isnan(best.efficiency):
        raise HmcvtError("no working point: the output speed and power cannot be held within the "
                         "engine speed limits" if hold == "output_speed" else
                         "no working point: the load cannot be carried at this engine speed")
    now = (math.nan if displacement_ratio is None
           else model.efficiency(displacement_ratio, engine_speed, load_torque))
    common.note_oil_temperature(model)
    point = common.Point(best.displacement_ratio, best.engine_speed, best.load_torque)
    if as_json:
        common.print_json({**asdict(best), "efficiency_now": now,
                           "inside_domain": common.inside_domain(model, point)})
        return
    click.echo(f"displacement ratio  {best.displacement_ratio:+.4f}")
    click.echo(f"efficiency          {best.efficiency:.4f}"
               + ("" if math.isnan(now) else f" (now {now:.4f})"))
    click.echo(f"engine speed        {best.engine_speed:.2f} rad/s "
               f"({best.engine_speed / RPM:.0f} r/min)")
    click.echo(f"load torque         {best.load_torque:.2f} N m")
    click.echo(f"output speed        {best.output_speed:.2f} rad/s")
    if best.limit is not None:
        click.echo(f"limited by          {best.limit}")
    common.print_domain(model, point)
    if displacement_ratio is not None and model.domain is not None:
        point = common.Point(displacement_ratio, engine_speed, load_torque)
        common.print_domain(model, point, "now ")

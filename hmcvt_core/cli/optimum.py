# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt optimum`."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import click

from ..errors import HmcvtError
from ..model.agreement import LOADS
from ..model.engine import load_engine
from ..model.model import EfficiencyModel
from ..model.optimum import HOLDS
from ..transmission.ranges import ENGINE_SPEED_LIMITS, RPM
from . import common
from .common import fraction, measured_options, output_speed, point_from, speed, stage_option

_ASKED = "the output speed and power cannot be held within the engine speed limits"
_OF_THE_DRIVE_LINE = ("engine", "torque_reserve", "hysteresis")


@click.command("optimum", epilog="""\b
Examples:
  hmcvt optimum --engine-speed 1400rpm --load-torque 200
  hmcvt optimum --engine-speed 2000rpm --load-torque 200 --hold output_speed \\
                --displacement-ratio -0.8
  hmcvt optimum --engine-speed 2000rpm --load-torque 200 --hold output_speed \\
                --output-speed 1250rpm --engine-speed-limits 900rpm 2100rpm --json
  hmcvt optimum --params params/tractor.yaml --output-speed 120 --output-power 40kW \\
                --engine params/engine.yaml --torque-reserve 15%""")
@click.option("--engine-speed", type=speed,
              help="Now: rad/s or 1400rpm. Without it the best of the drive line is found, over "
                   "all stages, at --output-speed and --output-power (or --output-torque).")
@measured_options
@click.option("--hold", type=click.Choice(HOLDS), default="engine_speed", show_default=True,
              help="What must stay; output_speed looks for the best engine speed too.")
@click.option("--displacement-ratio", type=fraction,
              help="Now; tells the output speed to hold and what there is to gain.")
@click.option("--engine-speed-limits", type=speed, nargs=2,
              help="Lowest and highest engine speed.  [default: 750rpm 2200rpm]")
@click.option("--engine", metavar="ENGINE.yaml",
              help="Full-load curve and fuel map: least fuel within the curve.")
@click.option("--torque-reserve", type=fraction, help="Part of the full-load torque to keep.")
@click.option("--hysteresis", type=fraction,
              help="Keep --stage unless another saves more than this part.")
@stage_option
@common.params_option
@common.json_option
def command(params: str | None, stage: str | None, as_json: bool, **given: Any) -> None:
    """Find the displacement ratio that wastes least, or the drive line's best working point."""
    limits = given["engine_speed_limits"] or ENGINE_SPEED_LIMITS
    if given["engine_speed"] is None:
        _drive_line(common.model_from(params), stage, limits, as_json, given)
        return
    for name in _OF_THE_DRIVE_LINE:
        if given[name] is not None:
            raise click.UsageError(f"--{name.replace('_', '-')} is of the drive line: leave out "
                                   "--engine-speed")
    _at_engine_speed(common.stage_from(params, stage).without_meters(), limits, as_json, given)


def _drive_line(
    model: EfficiencyModel, stage: str | None, limits: tuple[float, float], as_json: bool,
    given: dict[str, Any],
) -> None:
    held, power, torque = output_speed(given), given["output_power"], given["output_torque"]
    if held is None or (power is None) == (torque is None) or given["load_torque"] is not None \
            or given["engine_torque"] is not None or given["displacement_ratio"] is not None:
        raise click.UsageError("--engine-speed (now) is needed, or for the drive line "
                               "--output-speed and one of --output-power, --output-torque alone")
    engine = None if given["engine"] is None else load_engine(given["engine"])
    best = model.optimal_drive(
        held, abs(held) * torque if power is None else power, engine=engine,
        engine_speed_limits=limits, torque_reserve=given["torque_reserve"] or 0.0, stage=stage,
        hysteresis=given["hysteresis"] or 0.0)
    if best.stage is None:
        raise HmcvtError(f"no working point: {_ASKED}" + (
            "" if engine is None else " and the full-load curve of the engine"))
    found = asdict(best)
    per_loss = found.pop("fuel_per_loss")
    if as_json:
        common.print_json(found)
        return
    click.echo(f"stage               {best.stage}")
    _echo(found)
    click.echo(f"engine torque       {best.engine_torque:.2f} N m")
    if engine is not None:
        click.echo(f"fuel                {3.6e6 * best.fuel_rate:.0f} g/h "
                   f"({3.6e6 * per_loss:.3f} g/h for each watt lost)")


def _at_engine_speed(
    model: EfficiencyModel, limits: tuple[float, float], as_json: bool, given: dict[str, Any]
) -> None:
    # Refused: options that would be ignored or contradict each other.
    hold, stroke, held = given["hold"], given["displacement_ratio"], output_speed(given)
    if hold == "engine_speed" and (held is not None or given["engine_speed_limits"] is not None):
        raise click.UsageError(
            "--output-speed and --engine-speed-limits need --hold output_speed")
    if stroke is not None and held is not None:
        raise click.UsageError("--displacement-ratio (now) and --output-speed both tell the "
                               "output speed to hold: give one")
    engine_speed, load_torque = given["engine_speed"], given["load_torque"]
    if all(given[name] is None for name in LOADS):
        raise click.UsageError("--load-torque is needed, or another of what tells the load: "
                               "--output-power, --output-torque, --engine-torque")
    if load_torque is None and given["output_power"] is not None:
        load_torque = given["output_power"] / engine_speed
    elif load_torque is None:
        load_torque = point_from({**given, "oil_temperature": None}, model).load_torque
    best = model.optimal_displacement_ratio(
        engine_speed, load_torque, hold=hold, displacement_ratio=stroke, output_speed=held,
        engine_speed_limits=limits)
    if math.isnan(best.efficiency):
        raise HmcvtError(f"no working point: {_ASKED}" if hold == "output_speed" else
                         "no working point: the load cannot be carried at this engine speed")
    now = math.nan if stroke is None else model.efficiency(stroke, engine_speed, load_torque)
    common.note_oil_temperature(model)
    point = common.Point(best.displacement_ratio, best.engine_speed, best.load_torque)
    if as_json:
        common.print_json({**asdict(best), "efficiency_now": now,
                           "inside_domain": common.inside_domain(model, point)})
        return
    _echo(asdict(best), now)
    click.echo(f"output speed        {best.output_speed:.2f} rad/s")
    common.print_domain(model, point)
    if stroke is not None and model.domain is not None:
        common.print_domain(model, common.Point(stroke, engine_speed, load_torque), "now ")


def _echo(best: dict[str, Any], now: float = math.nan) -> None:
    click.echo(f"displacement ratio  {best['displacement_ratio']:+.4f}")
    click.echo(f"efficiency          {best['efficiency']:.4f}"
               + ("" if math.isnan(now) else f" (now {now:.4f})"))
    click.echo(f"engine speed        {best['engine_speed']:.2f} rad/s "
               f"({best['engine_speed'] / RPM:.0f} r/min)")
    click.echo(f"load torque         {best['load_torque']:.2f} N m")
    if best["limit"] is not None:
        click.echo(f"limited by          {best['limit']}")

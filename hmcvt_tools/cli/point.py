# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt predict`, `hmcvt breakdown` and `hmcvt optimum`: answers at one operating point."""

import math
from dataclasses import asdict
from typing import Any

import click

from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.files.bench import read_bench
from hmcvt_core.model.accuracy import mean_error
from hmcvt_core.model.engine import load_engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.operating_point import LOADS
from hmcvt_core.model.optimum import HOLDS, DriveOptimum, Optimum
from hmcvt_core.model.staged_samples import stage_of_each
from hmcvt_core.physics.balance import DRAGGED
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS, RPM

from ..report.pictures import draw_losses, save
from . import common
from .common import Answer, Point, domain_lines, point_from

_NOT_HELD = "the output speed and power cannot be held within the engine speed limits"
_DRIVE_LINE_OPTIONS = ("engine", "torque_reserve", "hysteresis", "inside_domain")
_TURNING = (None, DRAGGED)
"""Refusals with which the output shaft turns at a known speed: none, and overrun."""


@common.command(
    "predict",
    """
  hmcvt predict --displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt predict --displacement-ratio 50% --engine-speed 1400rpm --output-torque 180
  hmcvt predict --params params/tractor.yaml --stage HM3 --engine-speed 1800rpm \\
      --output-speed 1200rpm --output-power 40kW
  hmcvt predict data/table2.csv
  hmcvt predict data/table2.csv --params params/paper.yaml --json""",
    common.point_options,
    common.stage_option,
    common.params_option,
)
@click.argument("bench", metavar="[BENCH.csv]", required=False)
def predict(
    bench: str | None, params: str | None, stage: str | None, **given: Any
) -> Answer:
    """Predict the efficiency at one point, or at every sample of a file (with column `stage`)."""
    if bench is None:
        # At a single point no bench meter can read wrong.
        model = common.stage_from(params, stage).without_meters()
        return _predicted(model, point_from(given, model), given)
    if stage is not None or any(value is not None for value in given.values()):
        raise click.UsageError("give a file or the options of one point, not both")
    return _compared(common.model_from(params), bench)


def _predicted(model: EfficiencyModel, point: Point, given: dict[str, Any]) -> Answer:
    prediction = model.predict(*point)
    interval = model.interval_of(prediction)
    refusal = model.refusal(*point)
    common.note_oil_temperature(model, point.oil_temperature)
    solved = {}
    for name, value in point._asdict().items():
        if given[name] is None and value is not None:
            solved[name] = value
    speed = math.nan
    if refusal is None:
        low, high = interval
        spread = f"+- {prediction.standard_error:.4f} (90 %: {low:.4f} to {high:.4f})"
        if math.isnan(prediction.standard_error):
            spread = "(standard error unknown)"
        lines = [f"efficiency     {prediction.efficiency:.4f} {spread}"]
    else:
        lines = [f"no efficiency: {refusal}"]
    if refusal in _TURNING:
        speed = model.output_speed(*point)
        lines.append(f"output speed   {speed:.2f} rad/s")
        lines.append(f"power loss     {model.power_loss(*point):.0f} W")
    for name, value in solved.items():
        lines.append(f"{name.replace('_', ' '):<18} {value:.5g}")
    inside, outside_lines = domain_lines(model, point)
    result = {
        **prediction._asdict(),
        "interval_90": list(interval),
        "inside_domain": inside,
        "output_speed": speed,
        "refusal": refusal,
        **solved,
    }
    return Answer(result, [*lines, *outside_lines])


def _compared(model: EfficiencyModel, bench: str) -> Answer:
    samples = read_bench(bench)
    stage_of_each(model.stages, samples)  # raises where a sample names no known stage
    records = common.sample_records(model, samples)
    if samples.oil_temperature is None:
        common.note_oil_temperature(model)
    lines = [common.sample_table(records)]
    error = mean_error(model.efficiency(*samples.points), samples.efficiency)
    if not math.isnan(error):
        lines.append(f"mean |error|  {100 * error:.2f} %")
    unanswered = 0
    for record in records:
        if math.isnan(record["predicted"]):
            unanswered += 1
    if unanswered:
        lines.append(
            f"the model has no answer at {unanswered} of {len(records)} samples"
        )
    if samples.sha256 == model.provenance.get("data_sha256"):
        used = model.provenance.get("samples", "some")
        lines.append(
            f"the model was identified from {used} of these samples: others say more of "
            "it"
        )
    return Answer(records, lines)


@common.command(
    "breakdown",
    """
  hmcvt breakdown --displacement-ratio -0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt breakdown --displacement-ratio -0.5 --engine-speed 1400rpm --load-torque 200 \\
      --picture losses.png""",
    common.point_options,
    common.stage_option,
    common.picture_option,
    common.params_option,
)
def breakdown(
    picture: str | None, params: str | None, stage: str | None, **given: Any
) -> Answer:
    """Show where the watts go at one operating point; the picture goes over all strokes."""
    model = common.stage_from(params, stage).without_meters()
    point = point_from(given, model)
    refusal = model.refusal(*point)
    if refusal not in (None, DRAGGED):
        raise HmcvtError(f"no breakdown at this point: {refusal}")
    balance = model.breakdown(*point)
    common.note_oil_temperature(model, point.oil_temperature)
    if picture is not None:
        save(
            draw_losses,
            picture,
            model,
            point.engine_speed,
            point.load_torque,
            point.displacement_ratio,
        )
    input_power = float(balance.input_power)
    output_power = float(balance.output_power)
    losses = [(name, float(watts)) for name, watts in balance.losses.items()]
    losses.sort(key=lambda loss: -loss[1])
    rows = []
    for name, watts in (
        ("from the engine", input_power),
        *losses,
        ("to the load", output_power),
    ):
        # In overrun the load drives the transmission.
        share = 100.0 * watts / max(input_power, -output_power)
        # Adding 0.0 turns -0.0 into 0.0.
        rows.append((name, f"{round(watts)}", f"{round(share, 1) + 0.0:.1f}"))
    inside, outside_lines = domain_lines(model, point)
    result = {
        "input_power": input_power,
        "output_power": output_power,
        "efficiency": model.efficiency(*point),
        "losses": balance.losses,
        "inside_domain": inside,
    }
    shown = common.table(("part", "W", "% of input"), rows)
    return Answer(result, [shown, *outside_lines])


@common.command(
    "optimum",
    """
  hmcvt optimum --engine-speed 1400rpm --load-torque 200
  hmcvt optimum --engine-speed 2000rpm --load-torque 200 --hold output_speed \\
                --displacement-ratio -0.8
  hmcvt optimum --engine-speed 2000rpm --load-torque 200 --hold output_speed \\
                --output-speed 1250rpm --engine-speed-limits 900rpm 2100rpm --json
  hmcvt optimum --params params/tractor.yaml --output-speed 120 --output-power 40kW \\
                --engine params/engine.yaml --torque-reserve 15%""",
    common.measured_options,
    common.stage_option,
    common.params_option,
)
@click.option(
    "--engine-speed",
    type=common.speed,
    help="Now: rad/s or 1400rpm. Without it the best of the drive line is found, over "
    "all stages, at --output-speed and --output-power (or --output-torque).",
)
@click.option(
    "--hold",
    type=click.Choice(HOLDS),
    default="engine_speed",
    show_default=True,
    help="What must stay; output_speed looks for the best engine speed too.",
)
@click.option(
    "--displacement-ratio",
    type=common.fraction,
    help="Now; gives the output speed to hold and what there is to gain.",
)
@click.option(
    "--engine-speed-limits",
    type=common.speed,
    nargs=2,
    help="Lowest and highest engine speed.  [default: 750rpm 2200rpm]",
)
@click.option(
    "--engine",
    metavar="ENGINE.yaml",
    help="Full-load curve and fuel map: least fuel within the curve.",
)
@click.option(
    "--torque-reserve",
    type=common.fraction,
    help="Part of the full-load torque to keep.",
)
@click.option(
    "--hysteresis",
    type=common.fraction,
    help="Keep --stage unless another saves more than this part, 0 to 1.",
)
@click.option(
    "--inside-domain",
    is_flag=True,
    default=None,
    help="Only points within the data that the model was identified from.",
)
def optimum(params: str | None, stage: str | None, **given: Any) -> Answer:
    """Find the displacement ratio that loses least, or the drive line's best working point."""
    limits = given["engine_speed_limits"] or ENGINE_SPEED_LIMITS
    if given["engine_speed"] is None:
        return _of_drive_line(common.model_from(params), stage, limits, given)
    for name in _DRIVE_LINE_OPTIONS:
        if given[name] is not None:
            raise click.UsageError(
                f"{common.flag(name)} is of the drive line: leave out --engine-speed"
            )
    model = common.stage_from(params, stage).without_meters()
    return _of_one_stage(model, limits, given)


def _of_drive_line(
    model: EfficiencyModel,
    stage: str | None,
    limits: tuple[float, float],
    given: dict[str, Any],
) -> Answer:
    speed = given["output_speed"]
    _require_drive_line(given)
    power = given["output_power"]
    if power is None:
        power = abs(speed) * given["output_torque"]
    engine = None
    if given["engine"] is not None:
        engine = load_engine(given["engine"])
    if given["inside_domain"] and model.domain is None:
        raise InputError(
            "--inside-domain: the model does not state the range of its data; one that "
            "`hmcvt identify` wrote does"
        )
    best = model.optimal_drive(
        speed,
        power,
        engine=engine,
        engine_speed_limits=limits,
        torque_reserve=given["torque_reserve"] or 0.0,
        stage=stage,
        hysteresis=given["hysteresis"] or 0.0,
        inside_domain=bool(given["inside_domain"]),
    )
    if best.stage is None:
        reason = _NOT_HELD
        if engine is not None:
            reason += " and the full-load curve of the engine"
        if given["inside_domain"]:
            reason += " inside the domain of the model"
        reason += _reverse_hint(model, speed)
        raise HmcvtError(f"no working point: {reason}")
    common.note_oil_temperature(model)
    result = asdict(best)
    per_loss = result.pop("fuel_per_loss")
    lines = [
        f"stage               {best.stage}",
        *_best_lines(best),
        f"engine torque       {best.engine_torque:.2f} N m",
    ]
    if engine is not None:
        lines.append(
            f"fuel                {3.6e6 * best.fuel_rate:.0f} g/h "
            f"({3.6e6 * per_loss:.3f} g/h for each watt lost)"
        )
    point = Point(best.displacement_ratio, best.engine_speed, best.load_torque)
    inside, outside_lines = domain_lines(model, point)
    result["inside_domain"] = inside
    return Answer(result, [*lines, *outside_lines])


def _reverse_hint(model: EfficiencyModel, output_speed: float) -> str:
    """Say that reverse stages take a negative speed; empty where none is meant."""
    backward = [name for name, part in model.stages.items() if part.stage.reverse]
    if output_speed < 0.0 or not backward:
        return ""
    return f" (backward, in stage {', '.join(backward)}, --output-speed is negative)"


def _require_drive_line(given: dict[str, Any]) -> None:
    """Check that the options state an output speed and one load, and nothing else."""
    stated_loads = 0
    for name in ("output_power", "output_torque"):
        stated_loads += given[name] is not None
    excess = False
    for name in ("load_torque", "engine_torque", "displacement_ratio"):
        excess = excess or given[name] is not None
    if given["output_speed"] is None or stated_loads != 1 or excess:
        raise click.UsageError(
            "--engine-speed (now) is needed, or for the drive line "
            "--output-speed and one of --output-power, --output-torque alone"
        )


def _of_one_stage(
    model: EfficiencyModel, limits: tuple[float, float], given: dict[str, Any]
) -> Answer:
    hold = given["hold"]
    stroke = given["displacement_ratio"]
    output_speed = given["output_speed"]
    engine_speed = given["engine_speed"]
    limits_given = given["engine_speed_limits"] is not None
    if hold == "engine_speed" and (output_speed is not None or limits_given):
        raise click.UsageError(
            "--output-speed and --engine-speed-limits need --hold output_speed"
        )
    common.one_of(
        "set the output speed to hold",
        displacement_ratio=stroke,
        output_speed=output_speed,
    )
    load_torque = _load_torque(model, given)
    best = model.optimal_displacement_ratio(
        engine_speed,
        load_torque,
        hold=hold,
        displacement_ratio=stroke,
        output_speed=output_speed,
        engine_speed_limits=limits,
    )
    if math.isnan(best.efficiency):
        reason = "the load cannot be carried at this engine speed"
        if hold == "output_speed":
            reason = _NOT_HELD
        raise HmcvtError(f"no working point: {reason}")
    common.note_oil_temperature(model)
    point = Point(best.displacement_ratio, best.engine_speed, best.load_torque)
    inside, outside_lines = domain_lines(model, point)
    efficiency_now = math.nan
    if stroke is not None:
        efficiency_now = model.efficiency(stroke, engine_speed, load_torque)
        if inside is not None:
            now = Point(stroke, engine_speed, load_torque)
            outside_lines += domain_lines(model, now, "now ")[1]
    result = {
        **asdict(best),
        "efficiency_now": efficiency_now,
        "inside_domain": inside,
    }
    lines = [
        *_best_lines(best, efficiency_now),
        f"output speed        {best.output_speed:.2f} rad/s",
        *outside_lines,
    ]
    return Answer(result, lines)


def _load_torque(model: EfficiencyModel, given: dict[str, Any]) -> float:
    """Return the load torque that the options of a working point state [N m]."""
    if all(given[name] is None for name in LOADS):
        raise click.UsageError(
            "--load-torque is needed, or another option that states the load: "
            "--output-power, --output-torque, --engine-torque"
        )
    load_torque: float | None = given["load_torque"]
    if load_torque is not None:
        return load_torque
    if given["output_power"] is not None:
        return float(given["output_power"] / given["engine_speed"])
    return point_from({**given, "oil_temperature": None}, model).load_torque


def _best_lines(best: Optimum | DriveOptimum, now: float = math.nan) -> list[str]:
    efficiency = f"efficiency          {best.efficiency:.4f}"
    if not math.isnan(now):
        efficiency += f" (now {now:.4f})"
    lines = [
        f"displacement ratio  {best.displacement_ratio:+.4f}",
        efficiency,
        f"engine speed        {best.engine_speed:.2f} rad/s "
        f"({best.engine_speed / RPM:.0f} r/min)",
        f"load torque         {best.load_torque:.2f} N m",
    ]
    if best.limit is not None:
        lines.append(f"limited by          {best.limit}")
    return lines

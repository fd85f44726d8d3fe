# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt predict`, `hmcvt breakdown` and `hmcvt optimum`: answers at one operating point."""

import math
from dataclasses import asdict
from typing import Any

import click

from ..errors import HmcvtError
from ..files.bench import read_bench
from ..model.agreement import LOADS, mean_error, stage_of_each
from ..model.engine import load_engine
from ..model.model import EfficiencyModel
from ..model.optimum import HOLDS
from ..physics.balance import DRAGGED
from ..report.pictures import draw_losses, save
from ..transmission.ranges import ENGINE_SPEED_LIMITS, RPM
from . import common
from .common import Answer, Point, domain_told, point_from

_ASKED = "the output speed and power cannot be held within the engine speed limits"
_OF_THE_DRIVE_LINE = ("engine", "torque_reserve", "hysteresis")


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
        # At a point there is no bench whose meters could read wrong.
        model = common.stage_from(params, stage).without_meters()
        return _predicted(model, point_from(given, model), given)
    if stage is not None or any(value is not None for value in given.values()):
        raise click.UsageError("give a file or the options of one point, not both")
    return _compared(common.model_from(params), bench)


def _predicted(model: EfficiencyModel, point: Point, given: dict[str, Any]) -> Answer:
    found, refusal = model.predict(*point), model.refusal(*point)
    common.note_oil_temperature(model, point.oil_temperature)
    solved = {
        name: value
        for name, value in point._asdict().items()
        if given[name] is None and value is not None
    }
    # Stalled, or where formulas contradict themselves, the shaft does not turn as any says.
    speed = model.output_speed(*point) if refusal in (None, DRAGGED) else math.nan
    spread = (
        "(standard error unknown)"
        if math.isnan(found.standard_error)
        else f"+- {found.standard_error:.4f}"
    )
    lines = [
        f"efficiency     {found.efficiency:.4f} {spread}"
        if refusal is None
        else f"no efficiency: {refusal}"
    ]
    if refusal in (None, DRAGGED):
        lines += [
            f"output speed   {speed:.2f} rad/s",
            f"power loss     {model.power_loss(*point):.0f} W",
        ]
    lines += [
        f"{name.replace('_', ' '):<18} {value:.5g}" for name, value in solved.items()
    ]
    inside, told = domain_told(model, point)
    return Answer(
        {
            **found._asdict(),
            "inside_domain": inside,
            "output_speed": speed,
            "refusal": refusal,
            **solved,
        },
        [*lines, *told],
    )


def _compared(model: EfficiencyModel, bench: str) -> Answer:
    samples = read_bench(bench)
    stage_of_each(model.stages, samples)
    records = common.sample_records(model, samples)
    lines = [common.sample_table(records)]
    error = mean_error(model.efficiency(*samples.points), samples.efficiency)
    if not math.isnan(error):
        lines.append(f"mean |error|  {100 * error:.2f} %")
    if none := sum(math.isnan(entry["predicted"]) for entry in records):
        lines.append(f"the model has no answer at {none} of {len(records)} samples")
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
    found = model.breakdown(*point)
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
    into, out = float(found.input_power), float(found.output_power)
    losses = sorted(
        ((name, float(watts)) for name, watts in found.losses.items()),
        key=lambda entry: -entry[1],
    )
    rows = [("from the engine", into), *losses, ("to the load", out)]
    shown = common.table(
        ("part", "W", "% of input"),
        [
            # + 0.0: no loss reads 0.0, not -0.0.
            (
                name,
                f"{round(watts)}",
                f"{round(100 * watts / max(into, -out), 1) + 0.0:.1f}",
            )
            for name, watts in rows
        ],
    )
    inside, told = domain_told(model, point)
    return Answer(
        {
            "input_power": into,
            "output_power": out,
            "efficiency": model.efficiency(*point),
            "losses": found.losses,
            "inside_domain": inside,
        },
        [shown, *told],
    )


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
    help="Now; tells the output speed to hold and what there is to gain.",
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
    help="Keep --stage unless another saves more than this part.",
)
def optimum(params: str | None, stage: str | None, **given: Any) -> Answer:
    """Find the displacement ratio that wastes least, or the drive line's best working point."""
    limits = given["engine_speed_limits"] or ENGINE_SPEED_LIMITS
    if given["engine_speed"] is None:
        return _of_drive_line(common.model_from(params), stage, limits, given)
    for name in _OF_THE_DRIVE_LINE:
        if given[name] is not None:
            raise click.UsageError(
                f"--{name.replace('_', '-')} is of the drive line: leave out "
                "--engine-speed"
            )
    return _of_one_stage(
        common.stage_from(params, stage).without_meters(), limits, given
    )


def _of_drive_line(
    model: EfficiencyModel,
    stage: str | None,
    limits: tuple[float, float],
    given: dict[str, Any],
) -> Answer:
    held, power, torque = (
        given[f"output_{name}"] for name in ("speed", "power", "torque")
    )
    if (
        held is None
        or (power is None) == (torque is None)
        or any(
            given[name] is not None
            for name in ("load_torque", "engine_torque", "displacement_ratio")
        )
    ):
        raise click.UsageError(
            "--engine-speed (now) is needed, or for the drive line "
            "--output-speed and one of --output-power, --output-torque alone"
        )
    engine = None if given["engine"] is None else load_engine(given["engine"])
    best = model.optimal_drive(
        held,
        abs(held) * torque if power is None else power,
        engine=engine,
        engine_speed_limits=limits,
        torque_reserve=given["torque_reserve"] or 0.0,
        stage=stage,
        hysteresis=given["hysteresis"] or 0.0,
    )
    if best.stage is None:
        raise HmcvtError(
            f"no working point: {_ASKED}"
            + ("" if engine is None else " and the full-load curve of the engine")
        )
    found = asdict(best)
    per_loss = found.pop("fuel_per_loss")
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
    return Answer(found, lines)


def _of_one_stage(
    model: EfficiencyModel, limits: tuple[float, float], given: dict[str, Any]
) -> Answer:
    # Refused: options that would be ignored or contradict each other.
    hold, stroke, held = (
        given["hold"],
        given["displacement_ratio"],
        given["output_speed"],
    )
    if hold == "engine_speed" and (
        held is not None or given["engine_speed_limits"] is not None
    ):
        raise click.UsageError(
            "--output-speed and --engine-speed-limits need --hold output_speed"
        )
    common.one_of(
        "tell the output speed to hold", displacement_ratio=stroke, output_speed=held
    )
    engine_speed, load_torque = given["engine_speed"], given["load_torque"]
    if all(given[name] is None for name in LOADS):
        raise click.UsageError(
            "--load-torque is needed, or another of what tells the load: "
            "--output-power, --output-torque, --engine-torque"
        )
    if load_torque is None and given["output_power"] is not None:
        load_torque = given["output_power"] / engine_speed
    elif load_torque is None:
        load_torque = point_from({**given, "oil_temperature": None}, model).load_torque
    best = model.optimal_displacement_ratio(
        engine_speed,
        load_torque,
        hold=hold,
        displacement_ratio=stroke,
        output_speed=held,
        engine_speed_limits=limits,
    )
    if math.isnan(best.efficiency):
        raise HmcvtError(
            f"no working point: {_ASKED}"
            if hold == "output_speed"
            else "no working point: the load cannot be carried at this engine speed"
        )
    common.note_oil_temperature(model)
    point, now = (
        Point(best.displacement_ratio, best.engine_speed, best.load_torque),
        math.nan,
    )
    inside, lines = domain_told(model, point)
    if stroke is not None:
        now = model.efficiency(stroke, engine_speed, load_torque)
        if inside is not None:
            lines += domain_told(
                model, Point(stroke, engine_speed, load_torque), "now "
            )[1]
    return Answer(
        {**asdict(best), "efficiency_now": now, "inside_domain": inside},
        [
            *_best_lines(best, now),
            f"output speed        {best.output_speed:.2f} rad/s",
            *lines,
        ],
    )


def _best_lines(best: Any, now: float = math.nan) -> list[str]:
    lines = [
        f"displacement ratio  {best.displacement_ratio:+.4f}",
        f"efficiency          {best.efficiency:.4f}"
        + ("" if math.isnan(now) else f" (now {now:.4f})"),
        f"engine speed        {best.engine_speed:.2f} rad/s "
        f"({best.engine_speed / RPM:.0f} r/min)",
        f"load torque         {best.load_torque:.2f} N m",
    ]
    return (
        lines if best.limit is None else [*lines, f"limited by          {best.limit}"]
    )

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt predict`."""

from __future__ import annotations

import math
from typing import Any

import click

from ..files.bench import read_bench
from ..model.agreement import mean_error
from ..model.model import DRAGGED, EfficiencyModel
from . import common
from .common import point_from, point_options, stage_option


@click.command("predict", epilog="""\b
Examples:
  hmcvt predict --displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt predict --displacement-ratio 50% --engine-speed 1400rpm --output-torque 180
  hmcvt predict --params params/tractor.yaml --stage HM3 --engine-speed 1800rpm \\
      --output-speed 1200rpm --output-power 40kW
  hmcvt predict data/table2.csv
  hmcvt predict data/table2.csv --params params/paper.yaml --json""")
@click.argument("bench", metavar="[BENCH.csv]", required=False)
@point_options
@stage_option
@common.params_option
@common.json_option
def command(
    bench: str | None, params: str | None, stage: str | None, as_json: bool, **given: Any,
) -> None:
    """Predict the efficiency at one point, or at every sample of a file (with column `stage`)."""
    if bench is None:
        # At a point there is no bench whose meters could read wrong.
        model = common.stage_from(params, stage).without_meters()
        point = point_from(given, model)
        _predict_point(point, model, as_json, {
            name: value for name, value in point._asdict().items()
            if given[name] is None and value is not None})
    elif stage is not None or any(value is not None for value in given.values()):
        raise click.UsageError("give a file or the options of one point, not both")
    else:
        _predict_file(common.model_from(params), bench, as_json)


def _predict_point(
    point: common.Point, model: EfficiencyModel, as_json: bool, solved: dict[str, float]
) -> None:
    found, refusal = model.predict(*point), model.refusal(*point)
    common.note_oil_temperature(model, point.oil_temperature)
    # Stalled, or where formulas contradict themselves, the shaft does not turn as any says.
    speed = model.output_speed(*point) if refusal in (None, DRAGGED) else math.nan
    if as_json:
        common.print_json({**found._asdict(), "inside_domain": common.inside_domain(model, point),
                           "output_speed": speed, "refusal": refusal, **solved})
        return
    if refusal is not None:
        click.echo(f"no efficiency: {refusal}")
    else:
        spread = ("(standard error unknown)" if math.isnan(found.standard_error)
                  else f"+- {found.standard_error:.4f}")
        click.echo(f"efficiency     {found.efficiency:.4f} {spread}")
    if refusal in (None, DRAGGED):
        click.echo(f"output speed   {speed:.2f} rad/s")
        click.echo(f"power loss     {model.power_loss(*point):.0f} W")
    for name, value in solved.items():
        click.echo(f"{name.replace('_', ' '):<18} {value:.5g}")
    common.print_domain(model, point)


def _predict_file(model: EfficiencyModel, bench: str, as_json: bool) -> None:
    samples = read_bench(bench)
    records = common.sample_records(model, samples)
    if as_json:
        common.print_json(records)
        return
    click.echo(common.sample_table(records))
    error = mean_error(model.efficiency(*samples.points), samples.efficiency)
    if not math.isnan(error):
        click.echo(f"mean |error|  {100 * error:.2f} %")
    if none := sum(math.isnan(entry["predicted"]) for entry in records):
        click.echo(f"the model has no answer at {none} of {len(records)} samples")
    if samples.sha256 == model.provenance.get("data_sha256"):
        used = model.provenance.get("samples", "some")
        click.echo(f"the model was identified from {used} of these samples: others say more of it")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt predict`."""

from __future__ import annotations

import math

import click

from ..files.bench import read_bench
from ..model.agreement import RelativeError, predicted_at
from ..model.model import EfficiencyModel
from . import common


@click.command("predict", epilog="""\b
Examples:
  hmcvt predict --displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt predict data/table2.csv
  hmcvt predict data/table2.csv --params params/paper.yaml --json""")
@click.argument("bench", metavar="[BENCH.csv]", required=False)
@common.point_options
@common.params_option
@common.json_option
def command(bench: str | None, params: str | None, as_json: bool, **given: float | None) -> None:
    """Predict the efficiency at one point, or at every sample of a file."""
    if bench is None:
        # At a point there is no bench whose meters could read wrong.
        _predict_point(common.required(given), common.model_from(params).without_meters(), as_json)
    elif any(value is not None for value in given.values()):
        raise click.UsageError("give a file or the options of one point, not both")
    else:
        _predict_file(common.model_from(params), bench, as_json)


def _predict_point(point: common.Point, model: EfficiencyModel, as_json: bool) -> None:
    found, refusal = model.predict(*point), model.refusal(*point)
    common.note_oil_temperature(model, point.oil_temperature)
    # Where there is no efficiency the shaft does not turn as any formula says.
    speed = model.output_speed(*point) if refusal is None else math.nan
    if as_json:
        common.print_json({**found._asdict(), "inside_domain": common.inside_domain(model, point),
                           "output_speed": speed, "refusal": refusal})
        return
    if refusal is not None:
        click.echo(f"no efficiency: {refusal}")
    else:
        spread = ("(standard error unknown)" if math.isnan(found.standard_error)
                  else f"+- {found.standard_error:.4f}")
        click.echo(f"efficiency     {found.efficiency:.4f} {spread}")
        click.echo(f"output speed   {speed:.2f} rad/s")
    common.print_domain(model, point)


def _predict_file(model: EfficiencyModel, bench: str, as_json: bool) -> None:
    samples = read_bench(bench)
    records = common.sample_records(model, samples)
    if as_json:
        common.print_json(records)
        return
    click.echo(common.sample_table(records))
    error = RelativeError.of(predicted_at(model, samples), samples.efficiency)
    if error.without_answer < len(records):
        click.echo(f"mean |error|  {100 * error.mean:.2f} %")
    if error.without_answer:
        click.echo(f"the model has no answer at {error.without_answer} of {len(records)} samples")
    if samples.sha256 == model.provenance.get("data_sha256"):
        used = model.provenance.get("samples", "some")
        click.echo(f"the model was identified from {used} of these samples: others say more of it")

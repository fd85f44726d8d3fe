# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt separable`."""

from __future__ import annotations

import click

from ..benches.transmission import read_plan, separable
from . import common


@click.command("separable", epilog="""\b
Examples:
  hmcvt separable data/table2.csv
  hmcvt separable plan.csv --noise 0.004 --output-speed""")
@click.argument("plan", metavar="PLAN.csv")
@common.noise_option
@click.option("--output-speed", "output_speed", is_flag=True,
              help="As if the output speed were read too.")
@click.option("--pressure", "pressure", is_flag=True,
              help="As if the pressure over the motor were read too.")
@click.option("--matrix", "matrix", is_flag=True, help="Print every pair as a number too.")
@common.params_option
@common.json_option
def command(
    plan: str, noise: float | None, output_speed: bool, pressure: bool, matrix: bool,
    params: str | None, as_json: bool,
) -> None:
    """Tell which effects a test plan can show and tell apart, before any test is run.

    PLAN.csv needs displacement_ratio, engine_speed and load_torque; an efficiency in it is not
    used. Column oil_temperature counts as read, columns output_speed and pressure too.
    """
    model = common.model_from(params)
    asked = {"output_speed": output_speed, "pressure": pressure}
    channels = [name for name, wanted in asked.items() if wanted]
    found = separable(model, read_plan(plan, model, channels), noise=noise)
    if as_json:
        common.print_json(found.to_dict())
    else:
        click.echo(found.report(matrix))

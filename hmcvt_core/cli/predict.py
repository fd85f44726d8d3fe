# SPDX-License-Identifier: Apache-2.0
"""`hmcvt predict`."""

from __future__ import annotations

import click
import numpy as np

from ..bench import read_bench
from ..model import EfficiencyModel
from .common import (
    json_option,
    model_from,
    params_option,
    point_options,
    print_json,
    require,
    table,
)


@click.command("predict", epilog="""\b
Examples:
  hmcvt predict --displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt predict data/table2.csv --json""")
@click.argument("bench", metavar="[BENCH.csv]", required=False)
@point_options
@params_option
@json_option
def command(
    bench: str | None, displacement_ratio: float | None, engine_speed: float | None,
    load_torque: float | None, oil_temperature: float | None, params: str | None, as_json: bool,
) -> None:
    """Predict the efficiency at one point, or at every sample of a file."""
    model = model_from(params)
    if bench is not None:
        _predict_file(model, bench, as_json)
        return
    require(displacement_ratio=displacement_ratio, engine_speed=engine_speed,
            load_torque=load_torque)
    assert displacement_ratio is not None and engine_speed is not None and load_torque is not None
    point = (displacement_ratio, engine_speed, load_torque, oil_temperature)
    found, refusal = model.predict(*point), model.refusal(*point)
    if as_json:
        print_json({**found._asdict(), "output_speed": model.output_speed(*point),
                    "refusal": refusal})
    elif refusal is not None:
        click.echo(f"no efficiency: {refusal}")
    else:
        click.echo(f"efficiency     {found.efficiency:.4f} +- {found.standard_error:.4f}")
        click.echo(f"output speed   {model.output_speed(*point):.2f} rad/s")
        if not found.inside_domain:
            click.echo("outside the range of the data that the model was identified from")


def _predict_file(model: EfficiencyModel, bench: str, as_json: bool) -> None:
    s = read_bench(bench)
    found = model.predict(s.displacement_ratio, s.engine_speed, s.load_torque, s.oil_temperature)
    relative = (found.efficiency - s.efficiency) / s.efficiency
    if as_json:
        print_json([
            {"displacement_ratio": s.displacement_ratio[i], "engine_speed": s.engine_speed[i],
             "load_torque": s.load_torque[i], "measured": s.efficiency[i],
             "predicted": found.efficiency[i], "standard_error": found.standard_error[i],
             "inside_domain": found.inside_domain[i]} for i in range(len(s))])
        return
    rows = [(str(i + 1), f"{s.displacement_ratio[i]:.3f}", f"{s.engine_speed[i]:.2f}",
             f"{s.load_torque[i]:.2f}", f"{s.efficiency[i]:.4f}", f"{found.efficiency[i]:.4f}",
             f"{found.standard_error[i]:.4f}", f"{100 * relative[i]:+.2f} %",
             "" if found.inside_domain[i] else "outside") for i in range(len(s))]
    click.echo(table(("sample", "ratio [-]", "engine [rad/s]", "load [N m]", "measured",
                      "predicted", "std error", "error", "domain"), rows))
    click.echo(f"mean |error|  {100 * np.nanmean(np.abs(relative)):.2f} %")

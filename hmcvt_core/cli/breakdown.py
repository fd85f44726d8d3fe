# SPDX-License-Identifier: Apache-2.0
"""`hmcvt breakdown`."""

from __future__ import annotations

import click

from ..errors import HmcvtError
from .common import (
    inside_domain,
    json_option,
    model_from,
    note_oil_temperature,
    params_option,
    picture_option,
    point_options,
    print_domain,
    print_json,
    require,
    table,
)


@click.command("breakdown", epilog="""\b
Examples:
  hmcvt breakdown --displacement-ratio -0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt breakdown --displacement-ratio -0.5 --engine-speed 1400rpm --load-torque 200 \\
      --picture losses.png""")
@point_options
@picture_option
@params_option
@json_option
def command(
    displacement_ratio: float | None, engine_speed: float | None, load_torque: float | None,
    oil_temperature: float | None, picture: str | None, params: str | None, as_json: bool,
) -> None:
    """Show where the watts go at one operating point; the picture goes over all strokes."""
    require(displacement_ratio=displacement_ratio, engine_speed=engine_speed,
            load_torque=load_torque)
    assert displacement_ratio is not None and engine_speed is not None and load_torque is not None
    point = (displacement_ratio, engine_speed, load_torque)
    model = model_from(params).without_meters()
    refusal = model.refusal(*point, oil_temperature)
    if refusal is not None:
        raise HmcvtError(f"no breakdown at this point: {refusal}")
    found = model.breakdown(*point, oil_temperature)
    note_oil_temperature(model, oil_temperature)
    if picture is not None:
        from ..report import draw_losses, save

        save(lambda figure: draw_losses(figure, model, engine_speed, load_torque,
                                        displacement_ratio), picture)
    if as_json:
        print_json({"input_power": found.input_power, "output_power": found.output_power,
                    "efficiency": found.output_power / found.input_power,
                    "losses": dict(found.losses),
                    "inside_domain": inside_domain(model, *point)})
        return
    losses = sorted(found.losses.items(), key=lambda entry: -entry[1])
    rows = [("from the engine", found.input_power), *losses, ("to the load", found.output_power)]
    click.echo(table(("part", "W", "% of input"),
                     [(name, f"{round(float(watts))}", f"{100 * watts / found.input_power:.1f}")
                      for name, watts in rows]))
    print_domain(model, *point)

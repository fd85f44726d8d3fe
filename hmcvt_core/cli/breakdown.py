# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt breakdown`."""

from __future__ import annotations

from typing import Any

import click

from ..errors import HmcvtError
from ..model.model import STALLED
from . import common
from .common import point_from, point_options, stage_option


@click.command("breakdown", epilog="""\b
Examples:
  hmcvt breakdown --displacement-ratio -0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt breakdown --displacement-ratio -0.5 --engine-speed 1400rpm --load-torque 200 \\
      --picture losses.png""")
@point_options
@stage_option
@common.picture_option
@common.params_option
@common.json_option
def command(
    picture: str | None, params: str | None, stage: str | None, as_json: bool, **given: Any,
) -> None:
    """Show where the watts go at one operating point; the picture goes over all strokes."""
    model = common.stage_from(params, stage).without_meters()
    point = point_from(given, model)
    refusal = model.refusal(*point)
    if refusal == STALLED:
        raise HmcvtError(f"no breakdown at this point: {refusal}")
    found = model.breakdown(*point)
    common.note_oil_temperature(model, point.oil_temperature)
    if picture is not None:
        from ..report import draw_losses, save

        save(lambda figure: draw_losses(figure, model, point.engine_speed, point.load_torque,
                                        point.displacement_ratio), picture)
    if as_json:
        common.print_json({
            "input_power": found.input_power, "output_power": found.output_power,
            "efficiency": model.efficiency(*point), "losses": dict(found.losses),
            "inside_domain": common.inside_domain(model, point)})
        return
    into = float(found.input_power)
    given_power = max(into, -float(found.output_power))
    losses = sorted(((name, float(watts)) for name, watts in found.losses.items()),
                    key=lambda entry: -entry[1])
    rows = [("from the engine", into), *losses, ("to the load", float(found.output_power))]
    click.echo(common.table(("part", "W", "% of input"), [
        # + 0.0: no loss reads 0.0, not -0.0.
        (name, f"{round(watts)}", f"{round(100 * watts / given_power, 1) + 0.0:.1f}")
        for name, watts in rows]))
    common.print_domain(model, point)

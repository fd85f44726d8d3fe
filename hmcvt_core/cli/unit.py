# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt unit`."""

from __future__ import annotations

from contextlib import closing

import click

from ..benches.unit import diagnose_unit, put_into
from ..files.units import AXES, KINDS, read_unit
from ..model.parameter_file import save_model
from . import common


def _band(text: str) -> tuple[str, float]:
    axis, _, part = text.partition("=")
    if axis not in AXES:
        raise click.BadParameter(f"{axis!r} is none of {', '.join(AXES)}: write pressure=0.7")
    return axis, common.fraction(part)


@click.command("unit", epilog="""\b
Examples:
  hmcvt unit pump.csv
  hmcvt unit table.csv --kind motor --unit S4D --above pressure=0.7 --json
  hmcvt unit pump.csv --report pump.html --into params/tractor.yaml""")
@click.argument("table", metavar="UNIT.csv")
@click.option("--kind", type=click.Choice(KINDS), help="Of the unit, where no column says so.")
@click.option("--unit", metavar="NAME", help="Which one, where column `unit` names several.")
@click.option("--holdout", metavar="H.csv", help="Samples to measure the shrinkage on.")
@click.option("--above", type=_band, metavar="AXIS=PART",
              help="Hold out what lies above such a part of the highest pressure, speed or "
                   "displacement_ratio, and predict it: pressure=0.7.")
@click.option("--noise", type=click.FloatRange(1e-6, 0.2), metavar="STD",
              help="Standard deviation of flow and torque, as a part of the ideal ones.  [default: "
                   "0.0034, by class A of ISO 4409]")
@click.option("--report", type=common.OutputFile(), metavar="R.html", help="Write the report page.")
@common.effects_option
@click.option("--into", type=common.OutputFile(), metavar="TRACTOR.yaml",
              help="Put parameters and effects of this unit into a transmission's file.")
@common.seed_option
@common.json_option
def command(
    table: str, kind: str | None, unit: str | None, holdout: str | None,
    above: tuple[str, float] | None, noise: float | None, report: str | None, into: str | None,
    seed: int, as_json: bool,
) -> None:
    """Diagnose one pump or motor: its losses against the loss terms of the paper.

    UNIT.csv holds kind, displacement, displacement_ratio, speed, pressure, and flow_loss and
    torque_loss or volumetric_efficiency and mechanical_efficiency. In SI, or with the unit behind
    the name: pressure_bar, speed_rpm, displacement_cm3.
    """
    if holdout is not None and above is not None:
        raise click.UsageError("--holdout and --above both choose what is held out: give one")
    common.keep_inputs([table, holdout], [report, into])
    if report is not None:
        from ..report import check_drawable, write_html

        check_drawable()
    samples = read_unit(table, kind=kind, unit=unit, noise=noise)
    held = None if holdout is None else read_unit(
        holdout, kind=samples.kind, unit=unit, noise=noise)
    if above is not None:
        samples, held = samples.divided(*above)
    model = None if into is None else common.model_from(into)
    with closing(common.Progress("diagnosis")) as progress:
        found = diagnose_unit(samples, held, seed=seed, progress=progress)
    told = [found.report()]
    if into is not None and model is not None:
        save_model(put_into(model, found), into)
        told.append(f"{samples.kind} written into {into}")
    if report is not None:
        write_html(found, report)
        told.append(f"report written to {report}")
    if as_json:
        common.print_json(found.to_dict())
    else:
        click.echo("\n".join(told))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt diagnose`."""

from __future__ import annotations

from contextlib import closing

import click

from ..benches.transmission import diagnose
from ..diagnosis import Diagnosis
from ..files.bench import read_bench
from ..model import parameter_file
from . import common


@click.command("diagnose", epilog="""\b
Examples:
  hmcvt diagnose data/table2.csv
  hmcvt diagnose bench.csv --noise 0.004 --report report.html
  hmcvt diagnose bench.csv --holdout later.csv --save-model params/diagnosed.yaml --json""")
@click.argument("bench", metavar="BENCH.csv")
@common.params_option
@click.option("--holdout", metavar="H.csv",
              help="Samples to measure the shrinkage on; cross-validation when left out.")
@common.noise_option
@click.option("--report", "report", type=common.OutputFile(), metavar="R.html",
              help="Write the report page.")
@click.option("--save-model", type=common.OutputFile(), metavar="P.yaml",
              help="Write the model with the leading set of causes in it.")
@common.seed_option
@common.json_option
def command(
    bench: str, params: str | None, holdout: str | None, noise: float | None,
    report: str | None, save_model: str | None, seed: int, as_json: bool,
) -> None:
    """Diagnose the gap: where it lies, which effect causes it, how far it shrinks."""
    common.keep_inputs([bench, holdout], [report, save_model])
    common.keep_inputs([params], [report])
    if report is not None:
        from ..report import check_drawable, write_html

        check_drawable()
    model, samples = common.model_from(params), read_bench(bench)
    held = None if holdout is None else read_bench(holdout)
    with closing(common.Progress("diagnosis")) as progress:
        found = diagnose(model, samples, held, noise=noise, seed=seed, progress=progress)
    if save_model is not None:
        parameter_file.save_model(found.model, save_model)
    if report is not None:
        write_html(found, report)
    if as_json:
        common.print_json(found.to_dict())
        return
    click.echo(found.report())
    if save_model is not None:
        click.echo(f"model{_added(found)} written to {save_model}")
    if report is not None:
        click.echo(f"report written to {report}")


def _added(found: Diagnosis) -> str:
    if found.model is found.base:
        return ""
    leading = found.sets[0]
    names = " and ".join(leading.effects)
    if found.verdict == "cause_found":
        return f" with {names}"
    return f" with {names} ({100 * leading.probability:.0f} %, not certain)"

# SPDX-License-Identifier: Apache-2.0
"""`hmcvt identify`."""

from __future__ import annotations

import click
import numpy as np

from ..annealing import AnnealingState
from ..bench import BenchSamples, read_bench
from ..errors import InputError
from ..identification import Identification, identify
from ..model import FORMULATIONS
from ..parameter_file import load_stage
from ..resources import data_path
from .common import Progress, SampleNumbers, json_option, print_json, seed_option, table


@click.command("identify", epilog="""\b
Examples:
  hmcvt identify data/table2.csv
  hmcvt identify data/table2.csv --fit 1,2,4-6 --out params/mine.yaml
  hmcvt identify data/table2.csv --formulation published --gear-efficiency 0.98,0.97""")
@click.argument("bench", metavar="BENCH.csv")
@click.option("--fit", type=SampleNumbers(), default=None, metavar="1,2,4-6",
              help="Samples to fit, counted from 1; the rest are held back and predicted.")
@click.option("--formulation", type=click.Choice(FORMULATIONS), default="power_balance",
              show_default=True, help="Equations to use.")
@click.option("--gear-efficiency", "gears", default=None, metavar="0.98[,0.97...]",
              help="Of every gear pair; several are compared and the best is kept.")
@click.option("--transmission", default=None, metavar="T.yaml",
              help="Gear train; the paper's when left out.")
@click.option("--stage", default=None, metavar="NAME", help="Stage of the transmission file.")
@click.option("--out", default=None, metavar="P.yaml", help="Write the parameter file.")
@seed_option
@json_option
def command(
    bench: str, fit: list[int] | None, formulation: str, gears: str | None,
    transmission: str | None, stage: str | None, out: str | None, seed: int, as_json: bool,
) -> None:
    """Identify leakage and dampings from bench samples by improved simulated annealing."""
    samples = read_bench(bench)
    fitted, held = _split(samples, fit)
    train = load_stage(transmission or data_path("params/transmission.yaml"), stage)
    progress = Progress("annealing")

    def show(state: AnnealingState) -> None:
        progress(f"step {state.generation}, objective {state.value:.6g}")

    try:
        found = [identify(fitted, stage=train, formulation=formulation, gear_efficiency=value,
                          validation=held, seed=seed, progress=show)
                 for value in _efficiencies(gears)]
    finally:
        progress.close()
    best = min(found, key=lambda item: item.objective)
    if out is not None:
        best.save(out)
    if as_json:
        print_json(best.to_dict() if len(found) == 1
                   else {"best": best.to_dict(), "tried": [item.to_dict() for item in found]})
        return
    if len(found) > 1:
        click.echo(_comparison(found))
    click.echo(best.report())
    if out is not None:
        click.echo(f"written to {out}")


def _split(
    samples: BenchSamples, fit: list[int] | None
) -> tuple[BenchSamples, BenchSamples | None]:
    if fit is None:
        return samples, None
    if max(fit) > len(samples):
        raise InputError(f"--fit names sample {max(fit)}; {samples.source} holds {len(samples)}")
    chosen = np.array(fit) - 1
    rest = np.setdiff1d(np.arange(len(samples)), chosen)
    return samples.select(chosen), samples.select(rest) if len(rest) else None


def _efficiencies(text: str | None) -> list[float | None]:
    if text is None:
        return [None]
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"--gear-efficiency {text!r} is not a list of numbers") from None


def _comparison(found: list[Identification]) -> str:
    rows = []
    for item in found:
        held = "" if item.prediction_error is None else f"{100 * item.prediction_error:.2f} %"
        rows.append((f"{item.model.stage.gear_pairs[0].efficiency:g}", f"{item.objective:.6g}",
                     f"{100 * item.fit_error:.2f} %", held))
    return table(("gear efficiency", found[0].objective_name, "fit error", "prediction error"),
                 rows)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt identify`."""

from collections.abc import Sequence
from typing import Any

import click
import numpy as np

from hmcvt_core.errors import IdentificationError, InputError
from hmcvt_core.files.bench import BenchSamples, read_bench
from hmcvt_core.identification import Identification, identify
from hmcvt_core.identification.annealing import AnnealingRun
from hmcvt_core.identification.refit import refit
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import save_model
from hmcvt_core.physics.formulation import PUBLISHED

from ..report.pictures import draw_fit, save
from . import common
from .common import Answer

MAX_SAMPLES = 1_000_000
"""Highest sample number that --fit accepts: a larger range is a typing error."""


def _sample_numbers(text: str) -> list[int]:
    """Read sample numbers such as 1,2,4-6."""
    numbers: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            low = int(first)
            high = int(last) if dash else low
        except ValueError:
            raise click.BadParameter(
                f"{text!r} is not a list of sample numbers such as 1,2,4-6"
            ) from None
        if not 1 <= low <= high <= MAX_SAMPLES:
            raise click.BadParameter(
                f"{part!r}: sample numbers count up from 1 to at most {MAX_SAMPLES}"
            )
        numbers += range(low, high + 1)
    if len(set(numbers)) != len(numbers):
        raise click.BadParameter(f"{text!r} names a sample twice")
    return numbers


@common.command(
    "identify",
    """
  hmcvt identify data/table2.csv
  hmcvt identify data/table2.csv --fit 1,2,4-6 --out params/mine.yaml --picture fit.png
  hmcvt identify data/simulated.csv --hold-back 0.3
  hmcvt identify data/table2.csv --noise 0.8%
  hmcvt identify data/table2.csv --formulation published --gear-efficiency 0.98,0.97
  hmcvt identify bench.csv --transmission my_transmission.yaml""",
    common.model_options,
    common.effects_option,
    common.noise_option,
    common.picture_option,
    common.seed_option,
)
@click.argument("bench", metavar="BENCH.csv")
@click.option(
    "--fit",
    type=_sample_numbers,
    metavar="1,2,4-6",
    help="Samples to fit, counted from 1; the rest are held out and predicted.",
)
@click.option(
    "--hold-back",
    type=common.fraction,
    callback=common.part_up_to(0.9),
    metavar="PART",
    help="Hold back such a part of the samples at random (--seed).",
)
@click.option(
    "--params",
    metavar="P.yaml",
    help="Parameter file whose gear train is taken, with all its stages and its effects as "
    "they are: BENCH.csv has a column stage then.",
)
@click.option(
    "--refine",
    is_flag=True,
    help="Take the model of --params as prior, with its standard errors and effects: "
    "what the samples do not say stays, such as that of a unit tested before.",
)
@click.option(
    "--out",
    type=common.OutputFile(),
    metavar="P.yaml",
    help="Write the parameter file.",
)
def command(
    bench: str,
    fit: list[int] | None,
    hold_back: float | None,
    formulation: str,
    gears: list[float],
    transmission: str | None,
    stage: str | None,
    params: str | None,
    refine: bool,
    out: str | None,
    noise: float | None,
    picture: str | None,
    seed: int,
) -> Answer:
    """Identify leakage and dampings from bench samples.

    Improved simulated annealing finds the valley, a local search finishes it. Of a transmission
    file with several stages all are taken, and BENCH.csv names the stage of each sample in column
    stage; --stage restricts the fit to one.
    """
    common.one_of("choose the samples", fit=fit, hold_back=hold_back)
    common.keep_inputs([bench, transmission, params], [out, picture])
    samples = read_bench(bench)
    if refine:
        others = (fit, hold_back, gears, noise, picture, transmission, stage)
        if params is None or any(others):
            raise click.UsageError(
                "--refine goes with --params, --out, --seed and --json alone"
            )
        return _refined(samples, common.model_from(params), out, seed)

    fitted_numbers = _fitted_numbers(samples, fit, hold_back, seed)
    all_numbers = range(1, len(samples) + 1)
    held_numbers = sorted(set(all_numbers).difference(fitted_numbers))
    fitted = samples.select(np.array(fitted_numbers) - 1)
    held = samples.select(np.array(held_numbers) - 1) if held_numbers else None
    stages, effects = common.gear_train(params, transmission, stage)
    if effects and formulation == PUBLISHED.name:
        names = ", ".join(effect.name for effect in effects)
        click.echo(
            f"note: {params}: formulation {formulation} has no effects: {names} left out",
            err=True,
        )
        effects = ()

    tried = []
    with common.Progress("annealing") as progress:

        def show(run: AnnealingRun) -> None:
            progress(f"step {len(run.history)}, objective {run.value:.6g}")

        for gear_efficiency in gears or (None,):
            tried.append(
                identify(
                    fitted,
                    stage=stages,
                    formulation=formulation,
                    gear_efficiency=gear_efficiency,
                    effects=effects,
                    holdout=held,
                    noise=noise,
                    seed=seed,
                    progress=show,
                )
            )
    best = min(tried, key=lambda result: result.objective)
    if out is not None:
        best.save(out)
    if picture is not None:
        save(draw_fit, picture, best, held)
    return _answer(tried, best, fitted_numbers, held, held_numbers, out)


def _fitted_numbers(
    samples: BenchSamples, fit: list[int] | None, hold_back: float | None, seed: int
) -> list[int]:
    """Return the numbers of the samples to fit, counted from 1."""
    count = len(samples)
    if fit is not None:
        if max(fit) > count:
            raise InputError(
                f"--fit names sample {max(fit)}; {samples.source} holds {count}"
            )
        return fit
    held_count = 0
    if hold_back is not None:
        held_count = min(count - 1, max(1, round(hold_back * count)))
    order = np.random.default_rng(seed).permutation(count) + 1
    return sorted(order[held_count:].tolist())


def _answer(
    tried: Sequence[Identification],
    best: Identification,
    fitted_numbers: list[int],
    held: BenchSamples | None,
    held_numbers: list[int],
    out: str | None,
) -> Answer:
    lines = []
    if len(tried) > 1:
        lines.append(_comparison(tried))
    lines.append(best.report(fitted_numbers))
    values: list[dict[str, Any]] = []
    for result in tried:
        records = []
        if held is not None:
            records = common.sample_records(result.model, held, held_numbers)
            if result is best:
                lines += ["held out:", common.sample_table(records)]
        aside = [fitted_numbers[position - 1] for position in result.set_aside]
        values.append({**result.to_dict(), "set_aside": aside, "held_back": records})
    if out is not None:
        lines.append(f"written to {out}")
    if len(tried) == 1:
        return Answer(values[0], lines)
    return Answer({"best": values[tried.index(best)], "tried": values}, lines)


def _refined(
    samples: BenchSamples, prior: EfficiencyModel, out: str | None, seed: int
) -> Answer:
    """Refit a model to samples with itself as prior."""
    result = refit(samples, prior, prior, seed=seed)
    if out is not None:
        if result.refused:
            raise IdentificationError(f"{out}: not written: {result.refused}")
        save_model(result.model, out)
    parameters = result.model.parameters.to_mapping(result.model.standard_errors)
    notes = [*result.kept, *result.warnings]
    if result.refused:
        notes.append(result.refused)
    lines = []
    for name, entry in parameters.items():
        lines.append(
            f"{name} = {entry['value']:.4g} +- {entry['standard_error']:.2g} "
            f"{entry['unit']}"
        )
    lines.append(
        f"mean error {100 * result.error_before:.2f} % before, "
        f"{100 * result.error_after:.2f} % refined"
    )
    lines += [f"note: {note}" for note in notes]
    intervals = result.model.parameter_intervals()
    value = {
        "parameters": parameters,
        "interval_90": {name: list(ends) for name, ends in intervals.items()},
        "error_before": result.error_before,
        "error_after": result.error_after,
        "refused": result.refused or None,
        "notes": notes,
    }
    return Answer(value, lines)


def _comparison(tried: Sequence[Identification]) -> str:
    """Return a table of the gear efficiencies compared."""
    objective = tried[0].objective_name
    rows = []
    for result in tried:
        prediction = ""
        if result.prediction_error is not None:
            prediction = f"{100 * result.prediction_error:.2f} %"
        rows.append(
            (
                f"{result.model.stage.gear_pairs[0].efficiency:g}",
                f"{result.objective:.6g}",
                f"{100 * result.fit_error:.2f} %",
                prediction,
            )
        )
    return common.table(
        ("gear efficiency", objective, "fit error", "prediction error"), rows
    )

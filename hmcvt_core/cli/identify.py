# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt identify`."""

import click
import numpy as np

from ..errors import IdentificationError, InputError
from ..files.bench import BenchSamples, read_bench
from ..identification import Identification, identify
from ..identification.annealing import AnnealingRun
from ..identification.refit import refit
from ..model.model import EfficiencyModel
from ..model.parameter_file import save_model
from ..report.pictures import draw_fit, save
from . import common
from .common import Answer

_MOST_SAMPLES = 1_000_000


def _sample_numbers(text: str) -> list[int]:
    numbers: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError:
            raise click.BadParameter(
                f"{text!r} is not a list of sample numbers such as 1,2,4-6"
            ) from None
        if not 1 <= low <= high <= _MOST_SAMPLES:
            raise click.BadParameter(
                f"{part!r}: sample numbers count up from 1 to at most {_MOST_SAMPLES}"
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
  hmcvt identify data/table2.csv --formulation published --gear-efficiency 0.98,0.97""",
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
    help="Samples to fit, counted from 1; the rest are held back and predicted.",
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
    help="Parameter file whose gear train is taken, with all its stages: BENCH.csv has a "
    "column stage then.",
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

    Improved simulated annealing looks for the valley, a local search finishes it.
    """
    common.one_of("choose the samples", fit=fit, hold_back=hold_back)
    common.keep_inputs([bench, transmission, params], [out, picture])
    samples = read_bench(bench)
    if refine:
        if params is None or any(
            (fit, hold_back, gears, noise, picture, transmission, stage)
        ):
            raise click.UsageError(
                "--refine goes with --params, --out, --seed and --json alone"
            )
        return _refined(samples, common.model_from(params), out, seed)
    if fit is None:
        held_count = (
            0
            if hold_back is None
            else min(len(samples) - 1, max(1, round(hold_back * len(samples))))
        )
        order = np.random.default_rng(seed).permutation(len(samples)) + 1
        fit = sorted(order[held_count:].tolist())
    elif max(fit) > len(samples):
        raise InputError(
            f"--fit names sample {max(fit)}; {samples.source} holds {len(samples)}"
        )
    rest = sorted({*range(1, len(samples) + 1)}.difference(fit))
    fitted = samples.select(np.array(fit) - 1)
    held = samples.select(np.array(rest) - 1) if rest else None
    train, _ = common.gear_train(params, transmission, stage)
    with common.Progress("annealing") as progress:

        def show(run: AnnealingRun) -> None:
            progress(f"step {len(run.history)}, objective {run.value:.6g}")

        found = [
            identify(
                fitted,
                stage=train,
                formulation=formulation,
                gear_efficiency=value,
                holdout=held,
                noise=noise,
                seed=seed,
                progress=show,
            )
            for value in gears or (None,)
        ]

    records = [
        [] if held is None else common.sample_records(item.model, held, rest)
        for item in found
    ]
    best = min(found, key=lambda item: item.objective)
    if out is not None:
        best.save(out)
    if picture is not None:
        save(draw_fit, picture, best, held)
    lines = (
        [best.report(fit)]
        if len(found) == 1
        else [_comparison(found), best.report(fit)]
    )
    if held is not None:
        lines += ["held back:", common.sample_table(records[found.index(best)])]
    if out is not None:
        lines.append(f"written to {out}")
    tried = [
        {**item.to_dict(), "held_back": each}
        for item, each in zip(found, records, strict=True)
    ]
    return Answer(
        {"best": tried[found.index(best)], "tried": tried} if tried[1:] else tried[0],
        lines,
    )


def _refined(
    samples: BenchSamples, prior: EfficiencyModel, out: str | None, seed: int
) -> Answer:
    """Refit a model to samples with itself as prior, and tell."""
    found = refit(samples, prior, prior, seed=seed)
    if out is not None:
        if found.refused:
            raise IdentificationError(f"{out}: not written: {found.refused}")
        save_model(found.model, out)
    parameters = found.model.parameters.to_mapping(found.model.standard_errors)
    notes = [*found.kept, *found.warnings, *filter(None, [found.refused])]
    return Answer(
        {
            "parameters": parameters,
            "error_before": found.error_before,
            "error_after": found.error_after,
            "refused": found.refused or None,
            "notes": notes,
        },
        [
            *(
                "{} = {value:.4g} +- {standard_error:.2g} {unit}".format(name, **entry)
                for name, entry in parameters.items()
            ),
            f"mean error {100 * found.error_before:.2f} % before, "
            f"{100 * found.error_after:.2f} % refined",
            *(f"note: {note}" for note in notes),
        ],
    )


def _comparison(found: list[Identification]) -> str:
    head = ("gear efficiency", found[0].objective_name, "fit error", "prediction error")
    return common.table(
        head,
        [
            (
                f"{item.model.stage.gear_pairs[0].efficiency:g}",
                f"{item.objective:.6g}",
                f"{100 * item.fit_error:.2f} %",
                ""
                if item.prediction_error is None
                else f"{100 * item.prediction_error:.2f} %",
            )
            for item in found
        ],
    )

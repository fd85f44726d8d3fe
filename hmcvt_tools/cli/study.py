# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt study`: from a bench table and the gears to model, cause, next test and code."""

from __future__ import annotations

from pathlib import Path

import click

from hmcvt_core.model.parameter_file import load_stages

from ..export.c_model import BOUND_RANGE
from ..export.effect_tables import BOUND
from ..study import Study
from . import common
from .common import Answer
from .export import bound_option
from .import_table import skip_bad_option


@common.command(
    "study",
    """
  hmcvt study data/three_stages.csv stages.yaml --noise 0.25% --out study
  hmcvt study TABLE.xlsx GEARS.yaml --averaged --out study
  hmcvt study LATER.csv GEARS.yaml --baseline SOUND.csv --out year""",
    common.noise_option,
    skip_bad_option,
    bound_option,
    common.seed_option,
)
@click.argument("bench", metavar="BENCH")
@click.argument("gears", metavar="GEARS.yaml")
@click.option(
    "--out",
    "folder",
    required=True,
    metavar="FOLDER",
    help="Folder for all results; it must be new or empty.",
)
@click.option(
    "--baseline",
    metavar="SOUND",
    help="Bench of the same machine when it was sound: the model is identified from it, and "
    "only what has changed since is diagnosed.",
)
@click.option(
    "--averaged",
    is_flag=True,
    help="Of a table that is imported: every row is a steady test.",
)
@click.option(
    "--correct-signs",
    is_flag=True,
    help="Correct an output speed or a pressure that has the wrong sign in a whole stage.",
)
def command(
    bench: str,
    gears: str,
    folder: str,
    baseline: str | None,
    noise: float | None,
    bound: float | None,
    seed: int,
    averaged: bool,
    skip_bad: bool,
    correct_signs: bool,
) -> Answer:
    """Go from a bench and the gears to model, cause, next test and code, in one folder.

    BENCH is a bench file, or a table that `hmcvt import` understands without an answer to a
    question; GEARS.yaml is a transmission file. The page index.html leads with the answer and links
    the rest. A step that is not possible, such as an FMU without a C compiler, is named there; the
    others go on.
    """
    error = BOUND if bound is None else bound
    BOUND_RANGE.check(error)
    study = Study(Path(folder), noise, seed, averaged, skip_bad, correct_signs)
    stages = load_stages(gears)
    study.make_folder()
    samples = study.read(bench, "bench.csv", stages)
    sound = None
    if baseline is not None:
        sound = study.read(baseline, "baseline.csv", stages)
        # Before the work: minutes pass, and the wrong file is soon taken.
        for note in study.compare(samples, sound):
            click.echo(f"warning: {note}", err=True)
    # A line for each step: minutes pass.
    with common.Progress("study", every=0.0) as progress:
        progress("gear train")
        study.check_gears(stages)
        progress("model")
        fit = study.identify(samples, sound, stages)
        diagnosis = study.diagnose(fit.model, samples, sound, progress)
        progress("C and FMU")
        study.export(diagnosis.model, error)
    study.write_page(Path(gears).stem, diagnosis)
    for line in study.refusals:
        click.echo(f"note: {line}", err=True)
    lines = [diagnosis.report(), "", f"page written to {study.page}"]
    return Answer(study.to_dict(diagnosis), lines)

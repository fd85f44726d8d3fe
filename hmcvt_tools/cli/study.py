# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt study`: from a bench table and the gears to model, cause, next test and code."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from hmcvt_core.benches import transmission
from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.pipeline import with_tests_in_range
from hmcvt_core.diagnosis.results.sentences import handed_over
from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.files import plain
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import BenchSamples, read_bench, write_bench
from hmcvt_core.identification import Identification, identify
from hmcvt_core.model.model import EfficiencyModel, typical_model
from hmcvt_core.model.parameter_file import load_stages, save_model
from hmcvt_core.model.signs import sign_problems, with_corrected_signs
from hmcvt_core.transmission.check import check_stages
from hmcvt_core.transmission.ranges import REQUIRED_COLUMNS
from hmcvt_core.transmission.stage import Stage

from ..export import export_c, export_fmu
from ..report import write_report
from ..report.gap_map import draw_gap
from ..report.pictures import draw_fit, save
from ..report.power_paths import draw_power_paths
from ..report.study import StudyFile, StudyStep, study_page
from ..tables.raw import choose_columns, import_table
from . import common
from .common import Answer

PAGE = "index.html"


@common.command(
    "study",
    """
  hmcvt study data/three_stages.csv stages.yaml --noise 0.25% --out study
  hmcvt study TABLE.xlsx GEARS.yaml --averaged --out study
  hmcvt study LATER.csv GEARS.yaml --baseline SOUND.csv --out year""",
    common.noise_option,
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
    seed: int,
    averaged: bool,
    correct_signs: bool,
) -> Answer:
    """Go from a bench and the gears to model, cause, next test and code, in one folder.

    BENCH is a bench file, or a table that `hmcvt import` understands without an answer to a
    question; GEARS.yaml is a transmission file. The page index.html leads with the answer and links
    the rest. A step that is not possible, such as an FMU without a C compiler, is named there; the
    others go on.
    """
    study = _Study(Path(folder), noise, seed, averaged, correct_signs)
    stages = load_stages(gears)
    study.make_folder()
    with common.Progress("study") as progress:
        progress("bench")
        samples = study.read(bench, "bench.csv", stages)
        sound = None
        if baseline is not None:
            sound = study.read(baseline, "baseline.csv", stages)
        study.check_gears(stages)
        progress("model")
        fit = study.identify(samples, sound, stages)
        progress("diagnosis")
        diagnosis = study.diagnose(fit.model, samples, sound)
        progress("export")
        study.export(diagnosis.model)
    page = study_page(Path(gears).stem, diagnosis, study.steps, datetime.date.today())
    write_atomically(study.folder / PAGE, page)
    return study.answer(diagnosis)


class _Study:
    """The steps of a study and what they wrote.

    Args:
        folder: for all files.
        noise: standard deviation of the efficiency [-], or None.
        seed: of every random number.
        averaged: whether every row of a table is a test.
        correct_signs: whether wrong signs of a whole stage are corrected.
    """

    def __init__(
        self,
        folder: Path,
        noise: float | None,
        seed: int,
        averaged: bool,
        correct_signs: bool,
    ) -> None:
        self.folder = folder
        self.steps: list[StudyStep] = []
        self._noise = noise
        self._seed = seed
        self._averaged = averaged
        self._correct_signs = correct_signs

    def make_folder(self) -> None:
        """Make the folder.

        Raises:
            InputError: it holds something already.
        """
        if self.folder.exists() and (
            not self.folder.is_dir() or any(self.folder.iterdir())
        ):
            raise InputError(f"{self.folder}: exists and is not empty; name a new one")
        self.folder.mkdir(parents=True, exist_ok=True)

    def read(self, path: str, name: str, stages: Sequence[Stage]) -> BenchSamples:
        """Read a bench, check its signs and write it to the folder."""
        if _is_bench_file(path):
            samples = read_bench(path)
            lines = [f"{path}: {len(samples)} samples."]
        else:
            samples, lines = _imported(path, self._averaged)
        samples, note = self._with_signs(samples, stages)
        if note:
            lines.append(note)
        write_bench(self.folder / name, samples)
        file = StudyFile(name, "the samples as a bench file, in SI units")
        self.steps.append(StudyStep(f"Bench {Path(path).name}", tuple(lines), (file,)))
        return read_bench(self.folder / name)

    def _with_signs(
        self, samples: BenchSamples, stages: Sequence[Stage]
    ) -> tuple[BenchSamples, str]:
        """Return samples with the signs of bench files, and what was corrected."""
        corrected, signs = with_corrected_signs(typical_model(stages), samples)
        problems = "; ".join(sign_problems(signs))
        if not problems:
            return samples, ""
        if not self._correct_signs:
            raise InputError(
                f"{samples.source}: {problems} (--correct-signs does so here)"
            )
        return corrected, f"Signs corrected: {problems}."

    def check_gears(self, stages: Sequence[Stage]) -> None:
        """Check the gear train and draw its power paths."""
        check = check_stages(stages)
        lines = []
        for entry in check.stages:
            low, high = min(entry.ratios), max(entry.ratios)
            lines.append(
                f"{entry.name}: output speed / engine speed {low:.4f} to {high:.4f}, "
                f"{entry.direction}."
            )
        lines += [f"{remark}." for remark in check.remarks]
        files = self._write(
            "paths.svg",
            "sketch of the power paths",
            lambda path: save(draw_power_paths, path, stages, check),
        )
        self.steps.append(StudyStep("Gear train", tuple(lines), files))

    def identify(
        self,
        samples: BenchSamples,
        sound: BenchSamples | None,
        stages: Sequence[Stage],
    ) -> Identification:
        """Identify the model, from the sound samples where there are some."""
        fit = identify(
            samples if sound is None else sound,
            stage=list(stages),
            noise=self._noise,
            seed=self._seed,
        )
        fit.save(self.folder / "model.yaml")
        files = [
            StudyFile("model.yaml", "the model, for every other command (--params)")
        ]
        files += self._write(
            "fit.svg",
            "measured over predicted efficiency",
            lambda path: save(draw_fit, path, fit, None),
        )
        files += self._write_text("fit.txt", "all of it as text", fit.report())
        if sound is not None:
            # The diagnosis refits the sound machine with its own effects: a growth belongs to the
            # parameters of that, which the sheet states.
            self.steps.append(StudyStep("Model of the sound machine", (), tuple(files)))
            return fit
        lines = []
        for name, entry in fit.parameters.to_mapping(fit.standard_errors).items():
            lines.append(
                f"{name} {entry['value']:.4g} +- {entry['standard_error']:.2g} "
                f"{entry['unit']}."
            )
        self.steps.append(StudyStep("Model", tuple(lines), tuple(files)))
        return fit

    def diagnose(
        self,
        model: EfficiencyModel,
        samples: BenchSamples,
        sound: BenchSamples | None,
    ) -> Diagnosis:
        """Diagnose the gap and choose the next test."""
        diagnosis = with_tests_in_range(
            transmission.diagnose(
                model, samples, noise=self._noise, seed=self._seed, baseline=sound
            )
        )
        save_model(diagnosis.model, self.folder / "diagnosed.yaml")
        added = handed_over(diagnosis) or "no effect"
        files = [StudyFile("diagnosed.yaml", f"the model with {added}")]
        for name, meaning in (
            ("report.pdf", "one page to hand on"),
            ("report.html", "the whole diagnosis, with maps and residuals"),
        ):
            files += self._write(
                name, meaning, lambda path: write_report(diagnosis, path)
            )
        files += self._write(
            "gap.svg",
            "maps of the gap",
            lambda path: save(draw_gap, path, diagnosis),
        )
        report = diagnosis.report()
        files += self._write_text("diagnosis.txt", "all of it as text", report)
        value = json.dumps(plain(diagnosis.to_dict()), indent=1)
        files += self._write_text("diagnosis.json", "for programs", value)
        self.steps.append(StudyStep("Gap and cause", (), tuple(files)))
        advice = diagnosis.advice
        # The page leads with the next step: another wording of it here would compete.
        files = self._write_text(
            "next.txt", "the next test and the candidates", advice.report()
        )
        self.steps.append(StudyStep("Next test", (), tuple(files)))
        return diagnosis

    def export(self, model: EfficiencyModel) -> None:
        """Write the saved model as C and as an FMU."""
        files = self._write(
            "c",
            "C99 with a self-test, for a controller",
            lambda path: export_c(model, path),
        )
        files += self._write(
            "model.fmu", "for a simulator", lambda path: export_fmu(model, path)
        )
        self.steps.append(StudyStep("Code", (), tuple(files)))

    def answer(self, diagnosis: Diagnosis) -> Answer:
        """Return the answer of the command."""
        files: dict[str, str] = {}
        lines = [diagnosis.report(), ""]
        for step in self.steps:
            for file in step.files:
                files[file.path] = file.meaning
        lines.append(f"page written to {self.folder / PAGE}")
        value = {
            "folder": str(self.folder),
            "page": str(self.folder / PAGE),
            "files": files,
            "diagnosis": diagnosis.to_dict(),
        }
        return Answer(value, lines)

    def _write_text(self, name: str, meaning: str, text: str) -> list[StudyFile]:
        write_atomically(self.folder / name, text + "\n")
        return [StudyFile(name, meaning)]

    def _write(
        self, name: str, meaning: str, write: Callable[[str], Any]
    ) -> tuple[StudyFile, ...]:
        """Write a file of the study; one that is not possible is named on stderr and the page."""
        try:
            write(str(self.folder / name))
        except HmcvtError as error:
            reason = " ".join(str(error).split())
            click.echo(f"note: {name} is not written: {reason}", err=True)
            self.steps.append(StudyStep(f"Not written: {name}", (reason,)))
            return ()
        return (StudyFile(name, meaning),)


def _is_bench_file(path: str) -> bool:
    """Return whether the first line of a file names the columns of bench files."""
    try:
        with open(path, encoding="utf-8") as file:
            header = file.readline()
    except (OSError, UnicodeDecodeError):
        return False
    return all(name in header.lower().replace(" ", "_") for name in REQUIRED_COLUMNS)


def _imported(path: str, averaged: bool) -> tuple[BenchSamples, list[str]]:
    """Import a table by the columns that are proposed.

    Raises:
        InputError: the table leaves a question open, or rows cannot be used.
    """
    try:
        table, proposal = choose_columns(path, {}, guess=True, averaged=averaged)
        if proposal.questions:
            questions = "; ".join(str(question) for question in proposal.questions)
            raise InputError(questions)
        imported = import_table(table, proposal, averaged=averaged)
    except InputError as error:
        place = "" if str(error).startswith(path) else f"{path}: "
        raise InputError(
            f"{place}{error}; import it by itself first: hmcvt import {path} --out bench.csv"
        ) from None
    lines = [f"{path}: {len(imported.samples)} tests."]
    for quantity, column in proposal.columns.items():
        unit = f" [{column.unit}]" if column.unit else ""
        lines.append(f"{quantity} from column {column.name!r}{unit}.")
    lines += [f"Left out: {line}." for line in imported.left_out]
    lines += [f"{note}." for note in imported.notes]
    return imported.samples, lines

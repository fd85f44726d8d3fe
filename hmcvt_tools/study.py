# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A study: from a bench table and the gears to model, cause, next test and code, in one folder."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hmcvt_core.benches import transmission
from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.pipeline import with_tests_in_range
from hmcvt_core.diagnosis.results.sentences import handed_over
from hmcvt_core.diagnosis.settings import NAMED_SAMPLES
from hmcvt_core.errors import HmcvtError, InputError, in_one_line
from hmcvt_core.files import plain
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import BenchSamples, read_bench, write_bench
from hmcvt_core.identification import Identification, identify
from hmcvt_core.model.model import EfficiencyModel, typical_model
from hmcvt_core.model.parameter_file import save_model
from hmcvt_core.model.signs import sign_problems, with_corrected_signs
from hmcvt_core.transmission.check import check_stages
from hmcvt_core.transmission.ranges import REQUIRED_COLUMNS
from hmcvt_core.transmission.stage import Stage

from .export.c_folder import write_c
from .export.c_model import c_model
from .export.effect_tables import BoundError
from .export.fmu import write_fmu
from .report import write_report
from .report.gap_map import draw_gap
from .report.pictures import draw_fit, save
from .report.power_paths import draw_power_paths
from .report.study import StudyFile, StudyStep, study_page
from .tables.raw import Imported, choose_columns, first_rows, import_table

PAGE = "index.html"


class Study:
    """The steps of a study and what they wrote.

    Args:
        folder: for all files.
        noise: standard deviation of the efficiency [-], or None.
        seed: of every random number.
        averaged: whether every row of a table is a test.
        skip_bad: whether rows of a table that hold no test are left out.
        correct_signs: whether wrong signs of a whole stage are corrected.

    Attributes:
        folder: for all files.
        steps: so far.
        refusals: a line for each file that is not possible.
    """

    def __init__(
        self,
        folder: Path,
        noise: float | None,
        seed: int,
        averaged: bool,
        skip_bad: bool,
        correct_signs: bool,
    ) -> None:
        self.folder = folder
        self.steps: list[StudyStep] = []
        self.refusals: list[str] = []
        self._left_out: list[str] = []
        self._shared: list[str] = []
        self._noise = noise
        self._seed = seed
        self._averaged = averaged
        self._skip_bad = skip_bad
        self._correct_signs = correct_signs

    @property
    def page(self) -> Path:
        """The page that leads with the answer and links the rest."""
        return self.folder / PAGE

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
        """Read a bench, check its signs and write it to the folder.

        Returns:
            The samples, whose source is the file as given.
        """
        if _is_bench_file(path):
            samples = read_bench(path)
            lines = [f"{path}: {len(samples)} samples."]
        else:
            imported, lines = _imported(path, self._averaged, self._skip_bad)
            samples = imported.samples
            if imported.left_out:
                self._left_out.append(
                    _left_out_note(Path(path).name, imported.left_out)
                )
        samples, note = self._with_signs(samples, stages)
        if note:
            lines.append(note)
        write_bench(self.folder / name, samples)
        file = StudyFile(name, "the samples as a bench file, in SI units")
        self.steps.append(StudyStep(f"Bench {Path(path).name}", tuple(lines), (file,)))
        return samples

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

    def compare(self, samples: BenchSamples, sound: BenchSamples) -> list[str]:
        """Return notes on tests and days that both benches share."""
        notes = transmission.shared_test_notes(samples, sound)
        self._shared += notes
        return notes

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
        progress: Callable[[str], None],
    ) -> Diagnosis:
        """Diagnose the gap and choose the next test."""
        diagnosis = with_tests_in_range(
            transmission.diagnose(
                model,
                samples,
                noise=self._noise,
                seed=self._seed,
                progress=lambda text: progress(f"diagnosis, {text}"),
                baseline=sound,
            )
        )
        diagnosis = self._with_left_out(diagnosis)
        remarks = (*self._left_out, *self._shared)
        progress("report and maps")
        save_model(diagnosis.model, self.folder / "diagnosed.yaml")
        added = handed_over(diagnosis) or "no effect"
        files = [StudyFile("diagnosed.yaml", f"the model with {added}")]
        for name, meaning in (
            ("report.pdf", "one page to hand on"),
            ("report.html", "the whole diagnosis, with maps and residuals"),
        ):
            files += self._write(
                name, meaning, lambda path: write_report(diagnosis, path, remarks)
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
        notes = diagnosis.notes[len(diagnosis.warnings) :]
        lines = tuple(f"Note: {note}." for note in notes)
        self.steps.append(StudyStep("Gap and cause", lines, tuple(files)))
        advice = diagnosis.advice
        # The page leads with the next step: another wording of it here would compete.
        files = self._write_text(
            "next.txt", "the next test and the candidates", advice.report()
        )
        self.steps.append(StudyStep("Next test", (), tuple(files)))
        return diagnosis

    def _with_left_out(self, diagnosis: Diagnosis) -> Diagnosis:
        """Return a diagnosis whose notes name the rows of tables that were left out."""
        first = len(diagnosis.warnings)
        notes = (
            *diagnosis.notes[:first],
            *self._left_out,
            *diagnosis.notes[first:],
        )
        return replace(diagnosis, notes=notes)

    def export(self, model: EfficiencyModel, bound: float) -> None:
        """Write the saved model as C and as an FMU.

        Args:
            model: that was saved.
            bound: error of the efficiency that tables of effects may make [-].
        """
        try:
            code = c_model(model, bound=bound)
        except BoundError as error:
            saved = self.folder / "diagnosed.yaml"
            command = (
                f"hmcvt export --params {saved} --format c --out {self.folder / 'c'} "
                f"--bound {error.attainable:g}"
            )
            reason = f"{in_one_line(error)}: {command}, and so with --format fmu"
            self._refuse("c and model.fmu", reason)
            return
        files = self._write(
            "c",
            "C99 with a self-test, for a controller",
            lambda path: write_c(model, code, path),
        )
        files += self._write(
            "model.fmu", "for a simulator", lambda path: write_fmu(model, code, path)
        )
        lines = []
        if code.accuracy is not None:
            lines.append(f"It holds {code.accuracy.report()}.")
        self.steps.append(StudyStep("Code", tuple(lines), tuple(files)))

    def to_dict(self, diagnosis: Diagnosis) -> dict[str, Any]:
        """Return the outcome as plain data for JSON."""
        files = {file.path: file.meaning for step in self.steps for file in step.files}
        return {
            "folder": str(self.folder),
            "page": str(self.page),
            "files": files,
            "diagnosis": diagnosis.to_dict(),
        }

    def write_page(self, name: str, diagnosis: Diagnosis) -> None:
        """Write the page of all steps so far.

        Args:
            name: of the transmission.
            diagnosis: of the gap.
        """
        page = study_page(name, diagnosis, self.steps, datetime.date.today())
        write_atomically(self.page, page)

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
            self._refuse(name, in_one_line(error))
            return ()
        return (StudyFile(name, meaning),)

    def _refuse(self, name: str, reason: str) -> None:
        """Name what is not written, and why, in one line."""
        self.refusals.append(f"not written: {name}: {reason}")
        self.steps.append(StudyStep(f"Not written: {name}", (reason,)))


def _is_bench_file(path: str) -> bool:
    """Return whether the first line of a file names the columns of bench files."""
    try:
        with open(path, encoding="utf-8") as file:
            header = file.readline()
    except (OSError, UnicodeDecodeError):
        return False
    return all(name in header.lower().replace(" ", "_") for name in REQUIRED_COLUMNS)


def _imported(path: str, averaged: bool, skip_bad: bool) -> tuple[Imported, list[str]]:
    """Import a table by the columns that are proposed, and say how.

    Raises:
        InputError: the table leaves a question open, or rows cannot be used.
    """
    try:
        table, proposal = choose_columns(path, {}, guess=True, averaged=averaged)
        if proposal.questions:
            questions = "; ".join(str(question) for question in proposal.questions)
            raise InputError(questions)
        imported = import_table(table, proposal, averaged=averaged, skip_bad=skip_bad)
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
    return imported, lines


def _left_out_note(name: str, rows: Sequence[str]) -> str:
    """Return a note that names rows of a table that were left out.

    Args:
        name: of the table.
        rows: each with the reason.
    """
    return f"left out of {name}: {first_rows(rows, NAMED_SAMPLES)}"

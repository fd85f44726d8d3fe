# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The page of a study: what was found, and links to every file."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import NamedTuple

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words

from .answer import VERDICTS, how_far, members
from .style import render


class StudyFile(NamedTuple):
    """A file of a study.

    Attributes:
        path: relative to the page.
        meaning: what it holds.
    """

    path: str
    meaning: str


class StudyStep(NamedTuple):
    """One step of a study.

    Attributes:
        title: of the step.
        lines: what it found, one sentence each.
        files: what it wrote.
    """

    title: str
    lines: tuple[str, ...]
    files: tuple[StudyFile, ...] = ()


def study_page(
    machine: str,
    diagnosis: Diagnosis,
    steps: Sequence[StudyStep],
    date: datetime.date,
) -> str:
    """Return the page of a study.

    Args:
        machine: name of the machine.
        diagnosis: of its bench.
        steps: in their order.
        date: printed on the page.

    Raises:
        InputError: Jinja2 is missing.
    """
    return render(
        "study.html.j2",
        machine=machine,
        date=date.isoformat(),
        verdict=VERDICTS[diagnosis.verdict],
        headline=words.mechanic(diagnosis),
        second_line=diagnosis.second_line,
        members=members(diagnosis),
        size=how_far(diagnosis),
        next_step=words.next_step(diagnosis),
        warnings=diagnosis.warnings,
        steps=[step for step in steps if step.lines or step.files],
    )

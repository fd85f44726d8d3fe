# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What `hmcvt import` adds to imported samples: their sessions, and a check by the gear train."""

from __future__ import annotations

import re
from dataclasses import replace

from hmcvt_core.errors import InputError
from hmcvt_core.model.model import typical_model
from hmcvt_core.model.parameter_file import load_stages
from hmcvt_core.model.plausibility import gear_train_remarks
from hmcvt_core.transmission.check import check_stages

from ..tables.raw import Imported, Proposal
from ..tables.recordings import days_of
from ..tables.shafts import DOUBT, FALLS

SESSION = "session"


def with_session(imported: Imported, proposal: Proposal, column: str) -> Imported:
    """Return imported samples with the sessions that a column of the table names.

    Args:
        imported: by the proposal.
        proposal: names the column of the stamps, whose days are sessions if it is asked for.
        column: of the table.

    Raises:
        InputError: the column is not kept.
    """
    samples = imported.samples
    stamps = proposal.columns.get("stamp")
    if column in samples.extra:
        extra = dict(samples.extra)
        extra[SESSION] = extra.pop(column)
    elif stamps is not None and stamps.name == column and samples.stamp is not None:
        extra = {**samples.extra, SESSION: days_of(samples.stamp)}
    else:
        raise InputError(
            f"{samples.source}: --session {column!r} is no column that is kept; there is "
            f"{', '.join(samples.extra) or 'none'}, and the column of the stamps"
        )
    return imported._replace(samples=replace(samples, extra=extra))


def checked_by_gears(imported: Imported, transmission: str) -> Imported:
    """Return imported samples with notes on what contradicts a transmission file.

    Args:
        imported: from a table.
        transmission: path of the file; the table names its stages if it has several.

    Raises:
        InputError: the file is wrong, or a stage of the table is not in it.
    """
    stages = load_stages(transmission)
    _require_stages(imported, [stage.name for stage in stages], transmission)
    remarks = gear_train_remarks(typical_model(stages), imported.samples)
    rising = {entry.name: entry.rising for entry in check_stages(stages).stages}
    notes = [_without_doubt(note, rising) for note in imported.notes]
    agreed = () if remarks else (f"the speeds agree with {transmission}",)
    return imported._replace(notes=(*notes, *remarks, *agreed))


def _require_stages(imported: Imported, known: list[str], transmission: str) -> None:
    """Raise an `InputError` where a table names other stages than a transmission file."""
    samples = imported.samples
    named = sorted(set(samples.extra.get("stage", ())))
    if not set(named) <= set(known):
        raise InputError(
            f"{samples.source}: the stages are {', '.join(named)}, those of {transmission} "
            f"{', '.join(known)}: name them alike in both files"
        )


def _without_doubt(note: str, rising: dict[str, bool]) -> str:
    """Return a note that doubts the sign of the stroke only where the gear train does, too."""

    def judged(match: re.Match[str]) -> str:
        if rising.get(match["stage"], True):
            return match[0]
        return match[0].removesuffix(DOUBT) + ", as by the gears"

    pattern = rf"in (?P<stage>\S+) [^;]*?{re.escape(FALLS + DOUBT)}"
    return re.sub(pattern, judged, note)

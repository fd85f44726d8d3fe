# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`estimate` over many logs of machines, on processes of this machine or on a Dask cluster.

Each worker reads its log itself: on a cluster the paths have to mean the same everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from hmcvt_core.errors import HmcvtError, InputError
from hmcvt_core.model.engine import Engine
from hmcvt_core.model.model import EfficiencyModel

from ..estimation import Estimate, EstimateSettings, estimate
from ..estimation.totals import Totals
from ..logs.opening import is_log
from ..logs.selection import Stated
from ..logs.series import Report
from .executors import study_all


@dataclass(frozen=True)
class Job:
    """What is the same for every log.

    Attributes:
        model: of the transmission.
        engine: fuel map, or None.
        dbc: signals of a maker's messages, or None.
        stated: channels and settings that the user names.
        settings: errors of the bus.
    """

    model: EfficiencyModel
    engine: Engine | None = None
    dbc: str | None = None
    stated: Stated = field(default_factory=Stated)
    settings: EstimateSettings = field(default_factory=EstimateSettings)

    def run(
        self, path: str, out: str | None = None, progress: Report | None = None
    ) -> Estimate:
        """Estimate one log.

        Args:
            path: of the log.
            out: CSV file for its rows, or None.
            progress: called with how much of the log is read.

        Raises:
            InputError: as of `estimate`.
        """
        return estimate(
            path,
            self.model,
            self.engine,
            dbc=self.dbc,
            channels=self.stated.columns,
            reference_torque=self.stated.reference_torque,
            friction_torque=_part(self.stated.friction_torque),
            stage_names=self.stated.stage_names,
            group=self.stated.group,
            out=out,
            settings=self.settings,
            progress=progress,
        )


class Together(NamedTuple):
    """Estimates of several logs.

    Attributes:
        estimate: over all logs.
        broken: what is wrong with logs that could not be estimated, one sentence each.
    """

    estimate: Estimate
    broken: tuple[str, ...]


def logs_in(paths: Sequence[str]) -> list[Path]:
    """Return the logs that paths name; of a folder all logs in it and below.

    Raises:
        InputError: a folder holds none.
    """
    logs: list[Path] = []
    for text in paths:
        path = Path(text)
        if not path.is_dir():
            logs.append(path)
            continue
        inside = sorted(file for file in path.rglob("*") if is_log(file))
        if not inside:
            raise InputError(f"{path}: holds no log")
        logs += inside
    return logs


def estimate_together(
    job: Job,
    paths: Sequence[Path],
    executor: AbstractContextManager[Executor],
    progress: Callable[[int, int], None] | None = None,
) -> Together:
    """Estimate several logs and add them up; a broken one does not stop the rest.

    Args:
        job: the same for all.
        paths: of the logs.
        executor: where the work is done.
        progress: called with the logs done and all logs.

    Raises:
        HmcvtError: no log can be estimated.
    """
    totals = Totals()
    notes: dict[str, Sequence[str]] = {}
    broken: dict[str, str] = {}
    tasks = ((str(path), str(path.resolve())) for path in paths)
    outcomes = study_all(job.run, tasks, executor)
    for done, (name, outcome) in enumerate(outcomes, 1):
        if isinstance(outcome, str):
            broken[name] = outcome if name in outcome else f"{name}: {outcome}"
        else:
            totals.add(outcome.totals)
            notes[name] = outcome.notes
        if progress is not None:
            progress(done, len(paths))
    if not notes:
        raise HmcvtError("; ".join(broken.values()))
    in_order = [str(path) for path in paths]
    ordered = {name: notes[name] for name in in_order if name in notes}
    return Together(
        Estimate(totals, f"{len(notes)} logs", _joined_notes(ordered)),
        tuple(broken[name] for name in in_order if name in broken),
    )


def _joined_notes(notes: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return the notes of logs, each once, with the log or how many logs it holds for."""
    logs_by_note: dict[str, list[str]] = {}
    for name, lines in notes.items():
        for line in lines:
            logs_by_note.setdefault(line, []).append(name)
    joined = []
    for line, logs in logs_by_note.items():
        where = logs[0]
        if len(logs) > 1:
            where = f"{len(logs)} logs, {logs[0]} to {logs[-1]}"
        joined.append(f"{where}: {line}")
    return tuple(joined)


def _part(percent: float | None) -> float | None:
    return None if percent is None else 0.01 * percent

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How much each constant of the diagnosis matters: `python -m studies.blind.sensitivity`.

A constant is halved and doubled, and the same bench campaigns are diagnosed again. A constant whose
changes leave the answers as they are is not needed at its precision.
"""

import importlib
import os
import pkgutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

import hmcvt_core.diagnosis
from hmcvt_core.diagnosis import settings
from hmcvt_core.errors import InputError
from hmcvt_tools.cli.commands import run_command
from hmcvt_tools.cli.common import OutputFile
from hmcvt_tools.fleet.executors import Processes
from studies.blind.bench.judge import Case
from studies.blind.bench.properties import Bench
from studies.blind.bench.scores import Record, as_wanted, first_set
from studies.blind.bench.study import cases, judged
from studies.page import table
from studies.workers import recorded

UNCHANGED = "as it is"
FACTORS = (0.5, 2.0)


@dataclass(frozen=True)
class Trial:
    """One campaign, diagnosed with one constant changed.

    Attributes:
        constant: name in `hmcvt_core.diagnosis.settings`; empty for none.
        factor: of the change.
        case: the campaign.
    """

    constant: str
    factor: float
    case: Case

    @property
    def name(self) -> str:
        """Name of the change."""
        return f"{self.constant} x {self.factor:g}" if self.constant else UNCHANGED

    @property
    def key(self) -> str:
        """Name of the change and of the campaign, which no other trial has."""
        return f"{self.name}/{self.case.key}"


def numeric_constants() -> tuple[str, ...]:
    """Return the names of all constants of the diagnosis that can be halved."""
    names = []
    for name, value in vars(settings).items():
        if name.isupper() and _is_numeric(value):
            names.append(name)
    return tuple(names)


def _is_numeric(value: Any) -> bool:
    if isinstance(value, tuple):
        return all(isinstance(part, (int, float)) for part in value)
    return isinstance(value, (int, float))


def scaled(value: Any, factor: float) -> Any:
    """Return a number or every number of a tuple times a factor; whole numbers stay whole."""
    if isinstance(value, tuple):
        return tuple(scaled(part, factor) for part in value)
    if isinstance(value, int):
        return max(1, round(value * factor))
    return value * factor


@contextmanager
def changed(constant: str, factor: float) -> Iterator[None]:
    """Scale a constant in every module of the diagnosis while the block runs."""
    value = getattr(settings, constant)
    modules = [settings]
    package = hmcvt_core.diagnosis
    for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        module = importlib.import_module(info.name)
        if constant in vars(module):
            modules.append(module)
    try:
        for module in modules:
            setattr(module, constant, scaled(value, factor))
        yield
    finally:
        for module in modules:
            setattr(module, constant, value)


def run_trial(trial: Trial) -> Record:
    """Diagnose one campaign with its constant changed.

    A probability of one half becomes 1, which no diagnosis has to stand: the record then has the
    key `error`.
    """
    record: Record = {"change": trial.name}
    if not trial.constant:
        return {**record, **judged(trial.case)}
    with changed(trial.constant, trial.factor):
        try:
            return {**record, **judged(trial.case)}
        except ArithmeticError as error:
            return {**record, "error": str(error)}


def trials(constants: Sequence[str], todo: Sequence[Case]) -> list[Trial]:
    """Return every campaign with every constant as it is, halved and doubled."""
    known = numeric_constants()
    for name in constants:
        if name not in known:
            raise InputError(f"{name}: no constant of the diagnosis that can be halved")
    every = [Trial("", 1.0, case) for case in todo]
    for name in constants:
        for factor in FACTORS:
            every += [Trial(name, factor, case) for case in todo]
    return every


def sensitivity_table(records: Sequence[Record]) -> str:
    """Return what each change of a constant does to the answers, one change a line."""
    by_change: dict[str, dict[tuple[str, int], Record]] = {}
    for record in records:
        if "error" not in record:
            campaign = (record["kind"], record["seed"])
            by_change.setdefault(record["change"], {})[campaign] = record
    usual = by_change.pop(UNCHANGED)
    rows = []
    for change, changed_records in sorted(by_change.items()):
        pairs = []
        for campaign, record in changed_records.items():
            if campaign in usual:
                pairs.append((usual[campaign], record))
        rows.append((change, *_cells(pairs)))
    return table(_HEAD, rows)


_HEAD = (
    "change",
    "campaigns",
    "other verdict",
    "other first set",
    "right: gained",
    "lost",
    "largest change of a probability",
    "seconds: ratio",
)


def _cells(pairs: Sequence[tuple[Record, Record]]) -> tuple[str, ...]:
    """Compare the answers before and after a change, campaign by campaign."""
    verdicts = first_sets = gained = lost = 0
    largest = 0.0
    for before, after in pairs:
        verdicts += before["verdict"] != after["verdict"]
        first_sets += first_set(before) != first_set(after)
        gained += as_wanted(after) and not as_wanted(before)
        lost += as_wanted(before) and not as_wanted(after)
        largest = max(largest, _change_of_probability(before, after))
    seconds = sum(after["seconds"] for _, after in pairs)
    ratio = seconds / sum(before["seconds"] for before, _ in pairs)
    return (
        str(len(pairs)),
        str(verdicts),
        str(first_sets),
        str(gained),
        str(lost),
        f"{largest:.2f}",
        f"{ratio:.2f}",
    )


def _change_of_probability(before: Record, after: Record) -> float:
    """Return how much the probability of the set that was first changes."""
    if not before["classes"]:
        return 0.0
    first, probability = before["classes"][0]
    same = [p for classes, p in after["classes"] if classes == first]
    return float(abs(probability - sum(same)))


@click.command("sensitivity")
@click.option(
    "--constant",
    "constants",
    multiple=True,
    metavar="NAME",
    help="A constant to halve and double; may be given more than once.  [default: all]",
)
@click.option("--campaigns", type=click.IntRange(1), default=14, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=6000, show_default=True)
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    default=os.cpu_count() or 1,
    show_default="cores",
    help="Diagnoses side by side.",
)
@click.option(
    "--results",
    type=OutputFile(),
    default="sensitivity-results.jsonl",
    show_default=True,
    metavar="FILE",
    help="Where a run goes on after an interruption.",
)
def command(
    constants: tuple[str, ...], campaigns: int, seed: int, jobs: int, results: str
) -> None:
    """Halve and double constants of the diagnosis on development campaigns."""
    todo = cases(campaigns, seed, Bench())
    work = {
        trial.key: trial for trial in trials(constants or numeric_constants(), todo)
    }
    records: list[Record] = []
    with Processes(jobs) as pool:
        for record in recorded(pool, run_trial, work, Path(results)):
            records.append(record)
            if len(records) % 10 == 0:
                click.echo(f"{len(records)} of {len(work)} diagnoses", err=True)
    click.echo(sensitivity_table(records))


if __name__ == "__main__":
    run_command(command, "python -m studies.blind.sensitivity")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which change of a foreign gearbox is named a year after its commissioning.

    python -m studies.gearbox [--machines 30] [--tests 12] [--tests 24] [--tests 48] [--zero 0.3]
        [--zero 1.5] [--seed 57] [--jobs 2]

Every machine of the type has its own leakage and dampings. It is measured when it is sound and a
year later, on three days each, whose zeros of the torque meters are drawn anew. A worn machine
leaks by 60 % more. The model is identified from the sound campaign.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.benches.baseline.growth import Growth
from hmcvt_core.model.parameter_file import load_stages
from hmcvt_tools.fleet.executors import Processes
from studies.gearbox import box, tables
from studies.page import table

GROWTH = 0.6
"""Of the leakage of a worn machine."""
LEAKING = ("laminar_leakage",)
"""Set that names the wear."""
NOISE = 0.0025
SPREAD = 0.15
"""Standard deviation of the logarithm of leakage and dampings from machine to machine."""
YEAR = 1_000_000
"""Added to the seed of the sound campaign for that a year later."""


@dataclass(frozen=True)
class Case:
    """One machine and its two campaigns.

    Attributes:
        worn: whether it leaks more a year later.
        tests: in each stage.
        zero: deviation of the zeros of the meters / their class [-].
        seed: of machine and campaigns.
    """

    worn: bool
    tests: int
    zero: float
    seed: int


@dataclass(frozen=True)
class Answer:
    """What a diagnosis with a baseline says of a case.

    Attributes:
        case: that was diagnosed.
        verdict: of the diagnosis.
        thin: whether the baseline is called too thin.
        first: effects of the leading set.
        growth: of the leakage, None where it is not named.
    """

    case: Case
    verdict: str
    thin: bool
    first: tuple[str, ...]
    growth: Growth | None

    @property
    def alarm(self) -> bool:
        """Whether a change is reported."""
        return self.verdict != "no_gap"

    @property
    def named(self) -> bool:
        """Whether more leakage leads."""
        return self.alarm and self.first == LEAKING

    @property
    def holds(self) -> bool:
        """Whether the interval of the growth holds the true one."""
        if self.growth is None:
            return False
        low, high = self.growth.interval
        return low <= GROWTH <= high


def machine(seed: int) -> box.Machine:
    """Return a machine of the type."""
    random = np.random.default_rng(seed)
    leakage, motor, pump = np.exp(SPREAD * random.standard_normal(3))
    typical = box.Machine()
    return box.Machine(
        leakage * typical.leakage,
        motor * typical.motor_damping,
        pump * typical.pump_damping,
        box.TYPICAL_DRAG,
    )


def answered(case: Case) -> Answer:
    """Return the answer of the diagnosis to a case."""
    sound = machine(case.seed)
    later = sound
    if case.worn:
        later = replace(sound, leakage=(1.0 + GROWTH) * sound.leakage)
    first = box.campaign(sound, case.tests, case.seed, case.zero)
    second = box.campaign(later, case.tests, YEAR + case.seed, case.zero)
    baseline = tables.samples(first, "sound")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "box.yaml"
        path.write_text(tables.transmission_text(), encoding="utf-8")
        stages = list(load_stages(path))
    fit = hmcvt.identify(baseline, stage=stages, noise=NOISE)
    diagnosis = hmcvt.diagnose(
        fit.model, tables.samples(second, "later"), baseline=baseline, noise=NOISE
    )
    effects = diagnosis.sets[0].effects if diagnosis.sets else ()
    record = diagnosis.baseline
    growth = record.growth(diagnosis) if diagnosis.verdict != "no_gap" else None
    return Answer(case, diagnosis.verdict, record.excess.is_thin, effects, growth)


def rows(answers: Sequence[Answer]) -> list[tuple[str, ...]]:
    """Return a row for each number of tests and size of the zeros."""
    kinds = sorted({(answer.case.tests, answer.case.zero) for answer in answers})
    lines = []
    for tests, zero in kinds:
        alike = [a for a in answers if (a.case.tests, a.case.zero) == (tests, zero)]
        sound = [answer for answer in alike if not answer.case.worn]
        worn = [answer for answer in alike if answer.case.worn]
        lines.append(
            (
                str(tests),
                f"{zero:g}",
                _count(sound, "alarm"),
                _count(sound, "thin"),
                _count(worn, "alarm"),
                _count(worn, "named"),
                _count(worn, "holds"),
                _count(worn, "thin"),
            )
        )
    return lines


def _count(answers: Sequence[Answer], name: str) -> str:
    return f"{sum(getattr(a, name) for a in answers)} of {len(answers)}"


@click.command("gearbox")
@click.option("--machines", type=click.IntRange(1), default=30, show_default=True)
@click.option("--tests", type=click.IntRange(4), multiple=True, default=(12, 24, 48))
@click.option("--zero", "zeros", type=float, multiple=True, default=(0.3, 1.5))
@click.option("--seed", type=click.IntRange(0), default=57, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
def command(
    machines: int,
    tests: tuple[int, ...],
    zeros: tuple[float, ...],
    seed: int,
    jobs: int,
) -> None:
    """Measure alarms and names a year after the commissioning of a foreign gearbox."""
    cases = []
    for number in tests:
        for zero in zeros:
            for drawn in range(machines):
                for worn in (False, True):
                    cases.append(Case(worn, number, zero, seed + drawn))
    answers = []
    with Processes(jobs) as pool:
        for answer in pool.map(answered, cases):
            answers.append(answer)
            click.echo(str(answer), err=True)
    head = ("tests a stage", "zeros / class", "unchanged: alarms", "too thin")
    head += ("worn: seen", "leakage first", "interval holds 60 %", "too thin")
    click.echo(table(head, rows(answers)))


if __name__ == "__main__":
    command()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which change of a foreign gearbox is named a year after its commissioning.

    python -m studies.gearbox [--machines 30] [--tests 12] [--tests 24] [--tests 48] [--zero 0.3]
        [--zero 1.5] [--seed 257] [--jobs 2] [--answers FILE]

Every machine of the type has its own leakage and dampings. It is measured when it is sound and a
year later, on three days each, whose zeros of the torque meters are drawn anew. A worn machine
leaks by 60 % more. The model is identified from the sound campaign. The whole takes hours: a file
of answers is continued, and its table is printed at any time with `--machines 0`.

Seeds from 257 on are kept for the figures of docs/baseline.md; develop with seeds from 9000 on.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
from scipy.stats import binomtest

from hmcvt_tools.fleet.executors import Processes
from studies.gearbox.trial import Answer, Case, answered
from studies.page import table

COLUMNS = (
    ("unchanged: alarm", False, "alarm"),
    ("unchanged: baseline too thin", False, "thin"),
    ("unchanged: something absent named", False, "absent_named"),
    ("worn: no alarm, not called too thin", True, "quiet_unsaid"),
    ("worn: something absent named", True, "absent_named"),
    ("worn: baseline too thin", True, "thin"),
    ("worn: alarm", True, "alarm"),
    ("worn: in the pump", True, "in_pump"),
    ("worn: more leakage alone leads", True, "named"),
    ("worn: and its interval holds 60 %", True, "holds"),
)
"""What is counted, failures first: words, whether of worn machines, property of an answer."""


def rows(answers: Sequence[Answer]) -> list[tuple[str, ...]]:
    """Return a row for each number of tests and size of the zeros, and one of all."""
    kinds = sorted({(answer.case.tests, answer.case.zero) for answer in answers})
    lines = []
    for words, worn, name in COLUMNS:
        of_machines = [answer for answer in answers if answer.case.worn == worn]
        cells = [words]
        for kind in kinds:
            alike = [a for a in of_machines if (a.case.tests, a.case.zero) == kind]
            cells.append(f"{sum(getattr(a, name) for a in alike)} of {len(alike)}")
        cells.append(share(of_machines, name))
        lines.append(tuple(cells))
    return lines


def share(answers: Sequence[Answer], name: str) -> str:
    """Return how many answers have a property, with the 95 % Wilson interval of the share.

    Args:
        answers: all of one kind of machine.
        name: property of an answer.
    """
    if not answers:
        return "0 of 0"
    hits = sum(getattr(answer, name) for answer in answers)
    low, high = binomtest(hits, len(answers)).proportion_ci(method="wilson")
    return f"{hits} of {len(answers)} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"


def answers_table(answers: Sequence[Answer]) -> str:
    """Return the table of docs/baseline.md in Markdown."""
    kinds = sorted({(answer.case.tests, answer.case.zero) for answer in answers})
    heads = [f"{tests} tests, zeros {zero:g}" for tests, zero in kinds]
    return table(("", *heads, "all"), rows(answers))


def cases(
    machines: int, tests: Sequence[int], zeros: Sequence[float], seed: int
) -> list[Case]:
    """Return the cases, all kinds of each machine before the next machine.

    Args:
        machines: of every kind.
        tests: in each stage.
        zeros: deviations of the zeros of the meters / their class [-].
        seed: of the first machine.
    """
    drawn = []
    for number in range(machines):
        for count in tests:
            for zero in zeros:
                for worn in (False, True):
                    drawn.append(Case(worn, count, zero, seed + number))
    return drawn


def recorded(path: Path | None) -> list[Answer]:
    """Return the answers of a file, none if it is not there."""
    if path is None or not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines()
    return [Answer.from_line(line) for line in lines]


@click.command("gearbox")
@click.option("--machines", type=click.IntRange(0), default=30, show_default=True)
@click.option("--tests", type=click.IntRange(4), multiple=True, default=(12, 24, 48))
@click.option("--zero", "zeros", type=float, multiple=True, default=(0.3, 1.5))
@click.option("--seed", type=click.IntRange(0), default=257, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
@click.option(
    "--answers",
    "path",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File of answers, which is continued.",
)
def command(
    machines: int,
    tests: tuple[int, ...],
    zeros: tuple[float, ...],
    seed: int,
    jobs: int,
    path: Path | None,
) -> None:
    """Measure alarms and names a year after the commissioning of a foreign gearbox."""
    answers = recorded(path)
    done = {answer.case for answer in answers}
    open_cases = [c for c in cases(machines, tests, zeros, seed) if c not in done]
    with Processes(jobs) as pool:
        for answer in pool.map(answered, open_cases):
            answers.append(answer)
            click.echo(answer.to_line(), err=True)
            if path is not None:
                with path.open("a", encoding="utf-8") as file:
                    file.write(answer.to_line() + "\n")
    click.echo(answers_table(answers))


if __name__ == "__main__":
    command()

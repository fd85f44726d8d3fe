# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.poisoning`: refits to a worn unit, attacked and with bad samples."""

from collections import Counter
from pathlib import Path

import click
import numpy as np

from hmcvt_core.files.atomic import write_atomically
from hmcvt_tools.fleet.executors import Processes
from studies.page import render, table

from .attacks import ATTACKS, Outcome, attacked, diagnosed, harmful
from .campaign import Case, campaign

CASES = (
    Case("model in service of 96 samples"),
    Case("model in service of 5 samples", known=0),
    Case("model in service that states no errors", stated=False),
    Case("noise 0.2 %", noise=0.002),
    Case("noise 1 %", noise=0.01),
    Case("4 to 6 bad samples", bad=(4, 6)),
)
_SEEDS_OF_AN_ATTACK = 100_000
"""Distance between the seeds of two attacks."""

ATTACK_HEAD = (
    "attack",
    "harmful",
    "worst excess",
    "attacked adopted",
    "honest adopted",
    "diagnosed",
    "verdicts",
)
MISTAKE_HEAD = (
    "",
    "worst excess",
    "above 1",
    "median error in service",
    "clean",
    "spoiled",
    "clean not refused",
    "spoiled not refused",
    "bad samples rejected",
    "good samples rejected",
)


def attack_row(
    pool: Processes, number: int, campaigns: int, diagnoses: int, seed: int
) -> list[object]:
    """Return the row of one attack."""
    first = seed + number * _SEEDS_OF_AN_ATTACK
    tasks = [(number, first + i) for i in range(campaigns)]
    verdicts = Counter(pool.map(diagnosed, tasks[:diagnoses]))
    answered = verdicts.total() - verdicts[""]
    outcomes: list[Outcome] = list(pool.map(attacked, tasks))
    attack = ATTACKS[number]
    harm = sum(harmful(attack, outcome) for outcome in outcomes)
    worst = max(outcome.excess for outcome in outcomes)
    adopted = np.mean([outcome.adopted for outcome in outcomes])
    honest = np.mean([outcome.clean_adopted for outcome in outcomes])
    return [
        attack.what,
        harm,
        f"{100 * worst:.2f}",
        f"{100 * adopted:.0f} %",
        f"{100 * honest:.0f} %",
        f"{answered} of {verdicts.total()}",
        ", ".join(f"{name} {n}" for name, n in verdicts.most_common() if name),
    ]


def mistake_row(pool: Processes, case: Case, campaigns: int, seed: int) -> list[object]:
    """Return the row of one case of single bad samples."""
    tasks = [(case, seed + i) for i in range(campaigns)]
    records = list(pool.map(campaign, tasks))
    columns = {
        key: np.array([record[key] for record in records], dtype=float)
        for key in records[0]
    }
    best = np.maximum(columns["clean"], columns["served"])
    worse = columns["spoiled"] - best
    row: list[object] = [
        case.what,
        f"{100 * worse.max():.2f}",
        int((worse > 0.01).sum()),
    ]
    for key in ("served", "clean", "spoiled"):
        row.append(f"{100 * np.median(columns[key]):.1f}")
    for key in ("adopted", "adopted_spoiled", "found"):
        row.append(f"{100 * columns[key].mean():.1f} %")
    row.append(int(columns["blamed"].sum()))
    return row


@click.command("poisoning")
@click.option(
    "--campaigns",
    type=click.IntRange(1, 100_000),
    default=200,
    show_default=True,
    help="Campaigns of each row.",
)
@click.option(
    "--diagnoses",
    type=click.IntRange(1, 100_000),
    default=3,
    show_default=True,
    help="Campaigns of each attack that are diagnosed too.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(
    campaigns: int, diagnoses: int, seed: int, jobs: int, out: Path | None
) -> None:
    """Attack refits to a worn unit, and spoil single samples of it."""
    attacks = []
    mistakes = []
    with Processes(jobs) as pool:
        for number in range(len(ATTACKS)):
            attacks.append(attack_row(pool, number, campaigns, diagnoses, seed))
            click.echo(attacks[-1])
        for case in CASES:
            mistakes.append(mistake_row(pool, case, campaigns, seed))
            click.echo(mistakes[-1])
    if out is None:
        return
    # The worst first.
    attacks.sort(key=lambda row: (-int(str(row[1])), -float(str(row[2]))))
    page = render(
        "page.md.j2",
        Path(__file__).parent,
        campaigns=campaigns,
        seed=seed,
        total=campaigns * len(ATTACKS),
        attacks=table(ATTACK_HEAD, attacks),
        mistakes=table(MISTAKE_HEAD, mistakes),
    )
    write_atomically(out, page)


if __name__ == "__main__":
    command()

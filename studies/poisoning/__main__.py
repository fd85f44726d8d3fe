# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.poisoning`: refits to a worn unit, with and without bad samples."""

from pathlib import Path

import click
import numpy as np

from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.fleet.executors import Processes
from studies.page import render, table

from .campaign import Case, campaign

CASES = (
    Case("model in service of 96 samples"),
    Case("model in service of 5 samples", known=0),
    Case("model in service that states no errors", stated=False),
    Case("noise 0.2 %", noise=0.002),
    Case("noise 1 %", noise=0.01),
    Case("4 to 6 bad samples", bad=(4, 6)),
)


@click.command("poisoning")
@click.option(
    "--campaigns", type=click.IntRange(1, 100_000), default=200, show_default=True
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(campaigns: int, seed: int, jobs: int, out: Path | None) -> None:
    """Spoil 1 to 3 of 20 to 60 samples of a worn unit by 5 to 30 points, and refit."""
    rows = []
    with Processes(jobs) as pool:
        for case in CASES:
            found = list(
                pool.map(campaign, [(case, seed + i) for i in range(campaigns)])
            )
            served, clean, spoiled, adopted, also, seen, blamed = (
                np.array([record[key] for record in found], dtype=float)
                for key in found[0]
            )
            worse = spoiled - np.maximum(clean, served)
            rows.append(
                (
                    case.what,
                    f"{100 * worse.max():.2f}",
                    int((worse > 0.01).sum()),
                    *(
                        f"{100 * np.median(each):.1f}"
                        for each in (served, clean, spoiled)
                    ),
                    *(f"{100 * each.mean():.1f} %" for each in (adopted, also, seen)),
                    int(blamed.sum()),
                )
            )
            click.echo(rows[-1])
    head = (
        "",
        "worst excess",
        "above 1",
        "median error in service",
        "clean",
        "spoiled",
        "clean adopted",
        "spoiled adopted",
        "bad samples set aside",
        "good ones set aside",
    )
    if out is not None:
        write_atomically(
            out,
            render(
                "page.md.j2",
                Path(__file__).parent,
                campaigns=campaigns,
                seed=seed,
                table=table(head, rows),
            ),
        )


if __name__ == "__main__":
    command()

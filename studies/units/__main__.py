# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`python -m studies.units DIR`: the loss terms of the paper judged on real and simulated units."""

from collections import Counter
from pathlib import Path
from typing import Any

import click

from hmcvt_core.diagnosis.results.outcome import NAMING
from hmcvt_core.files.atomic import write_atomically
from hmcvt_tools.fleet.executors import Processes
from studies.page import Goal, goal_table, render, table

from .judge import judged, tried, units_in
from .simulate import FORMS

_PAIRS = (
    ("compressibility", "constant_torque"),
    ("orifice_leakage", "pressure_friction"),
    ("barrel_churning", "pressure_leakage"),
)


@click.command("units")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--campaigns",
    type=click.IntRange(1),
    default=20,
    show_default=True,
    help="Simulated units of each kind; four times as many without an effect.",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(
    folder: Path, campaigns: int, seed: int, jobs: int, out: Path | None
) -> None:
    """Judge the terms on every unit of DIR and on simulated ones."""
    samples = units_in(folder)
    kinds = [*((name,) for name in FORMS), *_PAIRS]
    tasks = [
        (names, 1000 * seed + 100_000 * i + j)
        for i, names in enumerate(kinds, 1)
        for j in range(campaigns)
    ] + [((), 1000 * seed + j) for j in range(10 * campaigns)]
    with Processes(jobs) as pool:
        real = dict(zip(samples, pool.map(judged, samples.values()), strict=True))
        answers = list(pool.map(tried, tasks, chunksize=4))
    page = written(real, answers, kinds, f"--campaigns {campaigns} --seed {seed}")
    click.echo(page)
    if out is not None:
        write_atomically(out, page)


def written(
    real: dict[str, Any], answers: list[Any], kinds: list[Any], how: str
) -> str:
    """Return the page."""
    left = [
        (
            name,
            whole["samples"],
            *_cells(whole, "{base:.2f}", "{with_effects:.2f}"),
            _named(whole["effects"]),
            whole["verdict"],
            "; ".join(whole["warnings"]) or "-",
        )
        for name, one in real.items()
        for whole in [one["whole"]]
    ]
    trials = []
    for names in kinds:
        own = [
            (verdict, first) for hidden, verdict, first in answers if hidden == names
        ]
        wrong = Counter(_named(first) for _, first in own if first != names)
        others = ", ".join(f"{name} ({count})" for name, count in wrong.most_common(3))
        trials.append(
            (
                _named(names),
                len(own),
                sum(first == names for _, first in own),
                sum(verdict == "cause_found" for verdict, _ in own),
                others or "-",
            )
        )
    hidden = [names == first for names, _, first in answers if names]
    right = sum(hidden) / len(hidden)
    none = [verdict for names, verdict, _ in answers if not names]
    alarms = sum(verdict != "no_gap" for verdict in none) / len(none)
    pumps = [one["pressure"]["errors"] for name, one in real.items() if "pump" in name]
    least = min(
        row["removed"]
        for one in real.values()
        for row in one["pressure"]["errors"].values()
    )
    worst = max(each["flow"]["holdout_with_effects"] for each in pumps)
    goals = [
        Goal(
            "flow loss of pumps above 70 % of the largest pressure, rms",
            "<= 0.35 L/min",
            f"{worst:.2f} L/min",
            worst <= 0.35,
        ),
        Goal(
            "minimum fraction of the squared gap removed there, any unit and channel",
            ">= 60 %",
            f"{100 * least:.0f} %",
            least >= 0.6,
        ),
        Goal(
            "simulated units: right set first",
            ">= 85 %",
            f"{100 * right:.0f} % of {len(hidden)}",
            right >= 0.85,
        ),
        Goal(
            "simulated units without an effect: false alarms",
            "<= 5 %",
            f"{100 * alarms:.0f} % of {len(none)}; a cause is named in "
            f"{sum(verdict in NAMING for verdict in none)}",
            alarms <= 0.05,
        ),
    ]
    led = Counter(
        effect
        for one in real.values()
        for part in one.values()
        for effect in part["effects"]
    )
    return render(
        "units.md.j2",
        Path(__file__).parent,
        how=how,
        goals=goal_table(goals),
        left=table(
            (
                "unit",
                "points",
                "flow, paper's terms [L/min]",
                "saved model",
                "torque, paper's terms [N m]",
                "saved model",
                "leading set",
                "verdict",
                "warning",
            ),
            left,
        ),
        trials=table(("hidden", "units", "leads", "cause found", "else"), trials),
        led=", ".join(f"{_named([name])} {count}" for name, count in led.most_common()),
        fits=3 * len(real),
    )


def _named(effects: Any) -> str:
    return " + ".join(name.replace("_", " ") for name in effects) or "none"


def _cells(one: dict[str, Any], *forms: str) -> list[str]:
    return [
        form.format(**row).replace("%", " %")
        for row in one["errors"].values()
        for form in forms
    ]


if __name__ == "__main__":
    command()

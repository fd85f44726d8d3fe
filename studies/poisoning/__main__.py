# SPDX-License-Identifier: Apache-2.0
"""`python -m studies.poisoning`: refits to a worn unit, with and without bad samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.identification.cross_validation import QUICK
from hmcvt_core.identification.refit import MAX_DRIFT, refit
from studies.page import table
from studies.workers import workers

WEAR = (2.0, 1.5, 1.5)  # highest factors of leakage and dampings
ERRORS = (0.05, 0.30)  # of a bad reading, of either sign


@dataclass(frozen=True)
class Case:
    """Conditions of a campaign.

    Attributes:
        what: them in words.
        noise: of the readings, relative.
        known: samples behind the model in service; 0 for `params/hm4.yaml`, which has five.
        bad: fewest and most bad samples.
        max_drift: of the refit.
    """

    what: str
    noise: float = 0.004
    known: int = 96
    bad: tuple[int, int] = (1, 3)
    max_drift: float = MAX_DRIFT


CASES = (
    Case("model in service of 96 samples"),
    Case("the same, drift of 10 points at most", max_drift=0.10),
    Case("model in service of 5 samples", known=0),
    Case("noise 0.2 %", noise=0.002),
    Case("noise 1 %", noise=0.01),
    Case("4 to 6 bad samples", bad=(4, 6)),
)


def campaign(task: tuple[Case, int]) -> dict[str, float | bool]:
    """Largest errors over the domain [-], of what serves after each refit."""
    case, seed = task
    rng = np.random.default_rng(seed)
    served = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    if case.known:
        served = hmcvt.identify(bench(served, rng, case.known, case.noise), schedule=QUICK,
                                stage=served.stage).model
    factors = rng.uniform(1.0, WEAR)
    worn = replace(served, parameters=hmcvt.HydraulicParameters(
        *(served.parameters.to_array() * factors).tolist()))
    samples = bench(worn, rng, int(rng.integers(20, 61)), case.noise)
    bad = rng.choice(len(samples), rng.integers(*case.bad, endpoint=True), replace=False)
    readings = samples.efficiency.copy()
    readings[bad] += rng.choice([-1.0, 1.0], len(bad)) * rng.uniform(*ERRORS, len(bad))
    good = np.setdiff1d(np.arange(len(samples)), bad)
    clean, spoiled = (
        refit(each, served, served, max_drift=case.max_drift) for each in (
            samples.select(good), replace(samples, efficiency=np.clip(readings, 0.01, 0.99))))
    domain = spoiled.model.domain
    assert domain is not None
    grid = np.meshgrid(*(np.linspace(low, high, 9) for low, high in domain.to_mapping().values()))
    truth = worn.efficiency(*grid)

    def error(model: hmcvt.EfficiencyModel) -> float:
        # Where the unit carries the load and the model says that it does not, nothing comes out.
        return float(np.nanmax(np.abs(np.nan_to_num(model.efficiency(*grid)) - truth)))

    serving = [error(served if each.refused else each.model) for each in (clean, spoiled)]
    return {"served": error(served), "clean": serving[0], "spoiled": serving[1],
            "adopted": not clean.refused, "adopted_spoiled": not spoiled.refused,
            "found": float(np.isin(bad + 1, spoiled.set_aside).mean()),
            "blamed": float(np.isin(good + 1, spoiled.set_aside).sum())}


def bench(
    unit: hmcvt.EfficiencyModel, rng: np.random.Generator, count: int, noise: float
) -> hmcvt.BenchSamples:
    """Measure a unit at random points of 18 to 60 kW that it can carry."""
    points = np.empty((3, 0))
    while points.shape[1] < count:
        speed = rng.uniform(80.0, 230.0)
        point = rng.uniform(-1.0, 1.0), speed, np.clip(rng.uniform(18e3, 60e3) / speed, 40.0, 400.0)
        if np.isfinite(unit.efficiency(*point)):
            points = np.column_stack([points, point])
    readings = unit.efficiency(*points) * (1.0 + noise * rng.standard_normal(count))
    return hmcvt.BenchSamples(points[0], points[1], points[2], np.clip(readings, 0.01, 0.99))


@click.command("poisoning")
@click.option("--campaigns", type=click.IntRange(1, 100_000), default=200, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), default=None)
def command(campaigns: int, seed: int, jobs: int, out: Path | None) -> None:
    """Spoil 1 to 3 of 20 to 60 samples of a worn unit by 5 to 30 points, and refit."""
    rows = []
    with workers(jobs) as pool:
        for case in CASES:
            found = list(pool.map(campaign, [(case, seed + i) for i in range(campaigns)]))
            served, clean, spoiled, adopted, also, seen, blamed = (
                np.array([record[key] for record in found], dtype=float) for key in found[0])
            worse = spoiled - np.maximum(clean, served)
            rows.append((case.what, f"{100 * worse.max():.2f}", int((worse > 0.01).sum()),
                         *(f"{100 * np.median(each):.1f}" for each in (served, clean, spoiled)),
                         *(f"{100 * each.mean():.1f} %" for each in (adopted, also, seen)),
                         int(blamed.sum())))
            click.echo(rows[-1])
    head = ("", "worst excess", "above 1", "median error in service", "clean", "spoiled",
            "clean adopted", "spoiled adopted", "bad samples set aside", "good ones set aside")
    if out is not None:
        write_atomically(out, PAGE.format(campaigns, seed, table(head, rows)))


PAGE = """# Bad samples

Written by `python -m studies.poisoning --campaigns {0} --seed {1}`; {0} campaigns in each row.

20 to 60 samples, spread over 18 to 60 kW, of a unit whose leakage is up to 2 and whose dampings are
up to 1.5 times those of the model in service. One to three of them read 5 to 30 points too low or
too high. The refit is made with them (spoiled) and without (clean).

Errors are the largest over the domain, in points of efficiency, of what serves afterwards. The
excess is the error after the spoiled refit, less the larger of those after the clean one and of the
model that served (goal: at most 1). Of the clean refits 95 % should be adopted.

{2}
"""

if __name__ == "__main__":
    command()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How well the reported regions hold the tests at which the gap is large.

    python -m studies.where [--campaigns 50] [--seed 54000000] [--jobs 2]

Campaigns of the twin and of the bench take turns; those that hide nothing are left out. The truth
is the efficiency of the machine without noise and meters, less what the refitted base model
predicts; it is large where it exceeds its rms over the tests. The F1 score of the union of the
regions is compared with those of the samples at which |gap_at| exceeds its rms, and of all samples.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import click
import numpy as np
import numpy.typing as npt

import hmcvt_core as hmcvt
from hmcvt_core.errors import InputError
from hmcvt_tools.fleet.executors import Processes
from studies.blind import conditions, trial
from studies.blind.bench import judge
from studies.blind.bench.campaign import Campaign as BenchCampaign
from studies.blind.effect import FloatArray
from studies.page import table
from studies.stability import FIRST_SEED, Case, bench_case, cases, diagnosed, twin_case

NOTHING_HIDDEN = ("none", "base off", "nothing", "base_off")
"""Kinds of campaign without a place to find."""


class Score(NamedTuple):
    """F1 scores of one campaign, None where no gap is reported.

    Attributes:
        generator: twin or bench.
        kind: what it hides.
        verdict: of the diagnosis.
        regions: of the union of the regions.
        field: of the samples at which the estimated gap exceeds its rms.
        everything: of all samples.
        count: number of regions.
    """

    generator: str
    kind: str
    verdict: str
    regions: float
    field: float
    everything: float
    count: int


def score(case: Case) -> Score | None:
    """Return the scores of a campaign; None where nothing is hidden, or no gap is reported."""
    try:
        kind, _, found = diagnosed(case)
    except InputError:
        return None
    if kind in NOTHING_HIDDEN or found.verdict == "no_gap":
        return None
    gap = true_gap(case, found)
    large = np.abs(gap) > np.sqrt(np.mean(gap**2))
    observed = found.posterior.base_only.fit.observed
    large = large[observed.number]
    mean, _ = found.posterior.gap_at()
    union = np.zeros(len(large), dtype=bool)
    for region in found.where:
        union |= _inside(region, observed)
    return Score(
        case.generator,
        kind,
        found.verdict,
        _f1(union, large),
        _f1(np.abs(mean) > np.sqrt(np.mean(mean**2)), large),
        _f1(np.ones_like(large), large),
        len(found.where),
    )


def _inside(region: Any, observed: Any) -> npt.NDArray[np.bool_]:
    """Return which samples of a diagnosis a region holds."""
    inside = np.ones(len(observed), dtype=bool)
    for axis in observed.axes:
        values = observed.points[axis.name]
        if axis.name in region.limits:
            low, high = region.limits[axis.name]
            inside &= (low <= values) & (values <= high)
        if axis.name in region.setting:
            label = region.setting[axis.name]
            inside &= values == axis.labels.index(label)
    return inside


def _f1(held: npt.NDArray[np.bool_], large: npt.NDArray[np.bool_]) -> float:
    both = np.sum(held & large)
    return float(2.0 * both / max(1, int(np.sum(held) + np.sum(large))))


def true_gap(case: Case, found: hmcvt.Diagnosis) -> FloatArray:
    """Return the efficiency of the machine less that of the refitted base, shape (n,)."""
    if case.generator == "twin":
        campaign = conditions.draw(twin_case(case))
        return np.nan_to_num(trial.left_over(campaign, found.base))
    bench_campaign, _ = judge.draw(bench_case(case))
    return np.nan_to_num(_bench_gap(bench_campaign, found.base))


def _bench_gap(campaign: BenchCampaign, base: Any) -> FloatArray:
    settings = campaign.settings
    state = campaign.state
    efficiency, points = judge.true_efficiency(campaign, settings, state)
    names = [campaign.layout.trains[number].name for number in campaign.programme.stage]
    return np.asarray(efficiency - judge.predicted(base, points, names))


def scores_table(scores: list[Score]) -> str:
    """Return mean F1 scores by generator in Markdown."""
    rows = []
    for generator in ("twin", "bench", "all"):
        own = [item for item in scores if generator in (item.generator, "all")]
        if own:
            means = np.mean(
                [(item.regions, item.field, item.everything) for item in own], axis=0
            )
            count = np.mean([item.count for item in own])
            figures = (f"{mean:.2f}" for mean in means)
            rows.append((generator, len(own), *figures, f"{count:.1f}"))
    head = ("", "campaigns", "regions", "field", "all samples", "number of regions")
    return table(head, rows)


@click.command("where")
@click.option("--campaigns", type=click.IntRange(1), default=50, show_default=True)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=FIRST_SEED,
    show_default=True,
    help="Of the first campaign.",
)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
def command(campaigns: int, seed: int, jobs: int) -> None:
    """Measure how well the regions hold where the gap is large."""
    with Processes(jobs) as pool:
        scores = list(pool.map(score, cases(campaigns, seed)))
    click.echo(scores_table([item for item in scores if item is not None]))


if __name__ == "__main__":
    command()

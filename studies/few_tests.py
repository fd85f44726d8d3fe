# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How often the 90 % intervals of `hmcvt identify` hold the truth with few tests.

    python -m studies.few_tests [--campaigns 40] [--seed 5] [--jobs 2]

A campaign is drawn from stage HM4 of the paper with parameters of its own; the form of the model is
exact, and the noise of the efficiency is normal with the paper's 1.12 %. Parameters and the
efficiency at fresh points within the data are compared with their 90 % intervals. Where the
noise is not stated and a model has a misfit, its intervals are those of a further reading (see
`docs/identify-reference.md`), and a fresh reading is compared with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import click
import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.files import data_path
from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.identification.misfit import FEWEST
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.model.parameter_file import load_stage
from hmcvt_core.transmission.parameters import (
    PAPER_EFFICIENCY_UNCERTAINTY,
    PARAMETER_NAMES,
    HydraulicParameters,
)
from hmcvt_core.transmission.ranges import Array
from hmcvt_core.transmission.stage import Stage
from hmcvt_tools.fleet.executors import Processes
from studies.page import table

KEPT_BACK = 98_600_000
"""Seeds from here on are for the page alone."""
NOISE = PAPER_EFFICIENCY_UNCERTAINTY
FRESH_POINTS = 50
OUTLIER = 8.0
"""Error of the one wrong test of a campaign with an outlier, in standard deviations."""
COLLINEAR_WIDTH = 0.05
"""Fraction of its range over which an axis varies in a collinear plan, besides the common line."""
TRUE_RANGES = np.array([[-11.2, -10.5], [0.03, 0.20], [0.05, 0.40]])
"""Of log10 leakage, motor damping and pump damping of the machines drawn."""
POINT_RANGES = np.array([[-0.9, 1.0], [100.0, 210.0], [120.0, 500.0]])
"""Of displacement ratio, engine speed [rad/s] and load torque [N m]."""


@dataclass(frozen=True)
class Kind:
    """Campaigns of one kind.

    Attributes:
        tests: number of tests.
        stated: whether the campaign states `efficiency_std`.
        plan: `spread` or `collinear`, where all three axes vary along one line.
        outlier: whether one test is wrong.
    """

    tests: int
    stated: bool
    plan: str = "spread"
    outlier: bool = False


KINDS = (
    *(Kind(tests, stated) for tests in (3, 4, 5, 8, 24) for stated in (False, True)),
    *(Kind(tests, False, plan="collinear") for tests in (5, 12)),
    *(Kind(tests, False, outlier=True) for tests in (12, 24)),
)


@dataclass(frozen=True)
class Campaign:
    """One campaign: its kind and its seed."""

    kind: Kind
    seed: int


@cache
def stage() -> Stage:
    """Return stage HM4 of the paper."""
    return load_stage(data_path("params/transmission.yaml"))


def points(count: int, plan: str, rng: np.random.Generator) -> Array:
    """Return displacement ratio, engine speed and load torque, shape (3, count)."""
    shares = rng.uniform(size=(3, count))
    if plan == "collinear":
        along = rng.uniform(size=count)
        shares = along + COLLINEAR_WIDTH * (shares - 0.5)
    low, high = POINT_RANGES.T
    return np.clip(
        low[:, None] + (high - low)[:, None] * shares, low[:, None], high[:, None]
    )


def measured(campaign: Campaign) -> dict[str, Any]:
    """Return which intervals of a campaign hold the truth."""
    kind = campaign.kind
    rng = np.random.default_rng([campaign.seed, kind.tests])
    scaled = rng.uniform(*TRUE_RANGES.T)
    parameters = HydraulicParameters(10.0 ** scaled[0], scaled[1], scaled[2])
    plant = EfficiencyModel(stage(), parameters)
    at = points(kind.tests, kind.plan, rng)
    efficiency = plant.efficiency(*at)
    readings = efficiency * (1.0 + NOISE * rng.standard_normal(kind.tests))
    if kind.outlier:
        readings[0] -= OUTLIER * NOISE * efficiency[0]
    stated = NOISE * readings if kind.stated else None
    samples = BenchSamples(*at, readings, efficiency_std=stated)
    model = hmcvt.identify(samples).model
    held = {}
    for name, (low, high) in model.parameter_intervals().items():
        held[name] = low <= getattr(parameters, name) <= high
    fresh = points(FRESH_POINTS, kind.plan, rng)
    truth = plant.efficiency(*fresh)
    if kind.tests >= FEWEST and not kind.stated:
        truth = truth * (1.0 + NOISE * rng.standard_normal(FRESH_POINTS))
    low, high = model.interval(*fresh)
    inside = (truth >= low) & (truth <= high)
    held["prediction"] = float(inside.mean())
    return {"kind": kind, "held": held, "width": float(np.nanmedian(high - low))}


def coverage_table(records: Sequence[dict[str, Any]]) -> str:
    """Return the coverage of each kind in Markdown."""
    rows = []
    for kind in KINDS:
        chosen = [record for record in records if record["kind"] == kind]
        if not chosen:
            continue
        cells = []
        for name in (*PARAMETER_NAMES, "prediction"):
            share = np.mean([record["held"][name] for record in chosen])
            cells.append(f"{100.0 * share:.0f} %")
        width = np.median([record["width"] for record in chosen])
        plan = kind.plan + (", one outlier" if kind.outlier else "")
        noise = "stated" if kind.stated else "not stated"
        rows.append((kind.tests, noise, plan, *cells, f"{100.0 * width:.2f} points"))
    names = [name.replace("_", " ") for name in PARAMETER_NAMES]
    head = ("tests", "noise", "plan", *names, "prediction", "width of prediction")
    return table(head, rows)


@click.command("few_tests")
@click.option(
    "--campaigns",
    type=click.IntRange(1),
    default=40,
    show_default=True,
    help="Of each kind.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=5,
    show_default=True,
    help=f"Of the first campaign of a kind; those from {KEPT_BACK} on are kept back.",
)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
def command(campaigns: int, seed: int, jobs: int) -> None:
    """Measure how often the 90 % intervals hold the truth."""
    cases = []
    for kind in KINDS:
        for number in range(campaigns):
            cases.append(Campaign(kind, seed + number))
    with Processes(jobs) as pool:
        records = list(pool.map(measured, cases))
    click.echo(coverage_table(records))


if __name__ == "__main__":
    command()

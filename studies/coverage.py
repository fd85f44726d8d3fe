# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How much of fresh truth the 95 % intervals of a model hold, on campaigns of the twin.

    python -m studies.coverage [--campaigns 20] [--seed 5] [--jobs 2]

A campaign is fitted by `hmcvt identify`, and diagnosed and saved by `hmcvt diagnose`, with and
without an empirical remainder. Each model then predicts fresh tests of the same plant, whose truth
is known without noise. The error of the saved model is compared with that of the
refitted base model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import click
import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import without_remainder
from hmcvt_core.errors import InputError
from hmcvt_tools.fleet.executors import Processes
from studies.blind.campaign import Campaign, fresh, make_campaign
from studies.blind.catalogue import UNKNOWN_EFFECTS
from studies.blind.conditions import MISFITS, SHIFTS, log_uniform
from studies.blind.effect import FloatArray
from studies.blind.trial import AXES, at_hand
from studies.page import table

KEPT_BACK = 98_500_000
"""Seeds from here on are for the page alone."""
BASES = ("exact", "off", "unlisted effect")
TESTS = (24, 96)
NOISES = (0.001, 0.004)
MODELS = ("identified", "diagnosed", "remainder")
INTERVAL = 1.96
"""Half-width of a 95 % interval, in standard errors."""
FRESH_SEED = 2**42
FRESH_TESTS = 300
MAX_DRAWS = 100
"""Draws of a plant until one carries the loads of its tests."""


@dataclass(frozen=True)
class Case:
    """One campaign.

    Attributes:
        base: one of `BASES`.
        tests: number of tests.
        noise: standard deviation of the efficiency [-].
        seed: of plant, effect, plan and noise.
    """

    base: str
    tests: int
    noise: float
    seed: int


def draw(case: Case) -> Campaign:
    """Measure a campaign on the first plant, of those drawn from its seed, that carries the loads.

    Raises:
        InputError: none of `MAX_DRAWS` does.
    """
    for attempt in range(MAX_DRAWS):
        rng = np.random.default_rng([case.seed, attempt])
        misfit = 0.0
        effects = []
        if case.base == "off":
            misfit = log_uniform(MISFITS, rng)
        elif case.base == "unlisted effect":
            name = str(rng.choice(UNKNOWN_EFFECTS))
            effects.append((name, log_uniform(SHIFTS, rng)))
        try:
            return make_campaign(
                MAX_DRAWS * case.seed + attempt,
                effects,
                samples=case.tests,
                efficiency_noise=case.noise,
                misfit=misfit,
            )
        except InputError:
            continue
    raise InputError(f"seed {case.seed}: no plant carries the loads of its tests")


def measured(case: Case) -> dict[str, Any]:
    """Return coverage and error of the models of a campaign, by model."""
    campaign = draw(case)
    shipped, samples = at_hand(campaign)
    diagnosis = hmcvt.diagnose(shipped, samples)
    models = {
        "identified": hmcvt.identify(samples).model,
        "diagnosed": without_remainder(diagnosis).model,
        "remainder": diagnosis.model,
    }
    tests = fresh(campaign, FRESH_SEED + case.seed, samples=FRESH_TESTS)
    coverage = {name: _coverage(model, tests) for name, model in models.items()}
    error = {name: _error(model, tests) for name, model in models.items()}
    return {
        "case": case,
        "verdict": diagnosis.verdict,
        "coverage": coverage,
        "error": error,
        "misfit": {name: model.misfit for name, model in models.items()},
        "base_error": _error(diagnosis.base, tests),
    }


def _missed(model: hmcvt.EfficiencyModel, tests: Campaign) -> FloatArray:
    """Return what a model misses of the truth at fresh tests [-], shape (n,)."""
    point = [tests.samples[axis] for axis in AXES]
    return np.asarray(tests.truth["efficiency"] - model.efficiency(*point))


def _coverage(model: hmcvt.EfficiencyModel, tests: Campaign) -> float:
    """Return the part of fresh tests whose truth lies in the 95 % interval."""
    prediction = model.predict(*(tests.samples[axis] for axis in AXES))
    missed = _missed(model, tests)
    answered = np.isfinite(missed)
    held = np.abs(missed) <= INTERVAL * prediction.standard_error
    return float(held[answered].mean())


def _error(model: hmcvt.EfficiencyModel, tests: Campaign) -> float:
    """Return the root mean square error at fresh tests [-]."""
    return float(np.sqrt(np.nanmean(_missed(model, tests) ** 2)))


def coverage_table(records: Sequence[dict[str, Any]]) -> str:
    """Return the coverage of each kind of campaign in Markdown."""
    rows = []
    for base, tests, noise in product(BASES, TESTS, NOISES):
        kind = []
        for record in records:
            case = record["case"]
            if (case.base, case.tests, case.noise) == (base, tests, noise):
                kind.append(record)
        if kind:
            label = (base, tests, f"{100.0 * noise:.1f} %", len(kind))
            rows.append((*label, *(_mean_coverage(kind, name) for name in MODELS)))
    total = [_mean_coverage(records, name) for name in MODELS]
    rows.append(("all", "", "", len(records), *total))
    head = ("base", "tests", "noise", "campaigns", "identified", "diagnosed")
    return table((*head, "with remainder"), rows)


def _mean_coverage(records: Sequence[dict[str, Any]], model: str) -> str:
    values = [record["coverage"][model] for record in records]
    return f"{100.0 * np.mean(values):.1f} %"


def error_table(records: Sequence[dict[str, Any]]) -> str:
    """Return errors of the saved model / refitted base, unlisted effects, in Markdown."""
    rows = []
    for tests, noise in product(TESTS, NOISES):
        ratios = []
        for record in records:
            case = record["case"]
            if (case.base, case.tests, case.noise) == (BASES[2], tests, noise):
                ratios.append(record["error"]["remainder"] / record["base_error"])
        if ratios:
            worse = sum(ratio > 1.05 for ratio in ratios)
            rows.append(
                (
                    tests,
                    f"{100.0 * noise:.1f} %",
                    f"{np.median(ratios):.2f}",
                    f"{max(ratios):.2f}",
                    f"{worse} of {len(ratios)}",
                )
            )
    head = ("tests", "noise", "median", "largest", "above 1.05")
    return table(head, rows)


@click.command("coverage")
@click.option(
    "--campaigns",
    type=click.IntRange(1),
    default=20,
    show_default=True,
    help="Of each kind: base, number of tests and noise.",
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
    """Measure how much of fresh truth the 95 % intervals hold."""
    cases = []
    for base, tests, noise in product(BASES, TESTS, NOISES):
        for number in range(campaigns):
            cases.append(Case(base, tests, noise, seed + number))
    with Processes(jobs) as pool:
        records = list(pool.map(measured, cases))
    click.echo(coverage_table(records))
    click.echo("\nError of the saved model / error of the refitted base:\n")
    click.echo(error_table(records))


if __name__ == "__main__":
    command()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification, and the annealing by itself."""

from functools import partial
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from studies.page import Goal, spread, table

from .timing import Section, at_most, in_turns

FIT = np.array([1, 2, 4, 5, 6]) - 1  # section 4.2 of the paper
CASES: dict[str, tuple[str, Any]] = {
    "5 samples of Table 2": ("table2", FIT),
    "all 8 samples of Table 2": ("table2", slice(None)),
    "96 simulated samples": ("simulated", slice(None)),
}
SEEDS, NEAR = 100, 1.01
LIMITS = {24: 0.15, 96: 0.25}
"""Seconds by number of samples."""


def samples_of(case: str) -> hmcvt.BenchSamples:
    """Read the samples of a case."""
    file, chosen = CASES[case]
    samples = hmcvt.read_bench(hmcvt.data_path(f"data/{file}.csv"))
    return samples.select(np.arange(len(samples))[chosen])


def section(quick: bool) -> Section:
    """Time and check all of it."""
    largest = samples_of("96 simulated samples")
    goals = []
    for count, limit in LIMITS.items():
        samples = largest.select(np.arange(0, len(largest), len(largest) // count))
        fit = {"ours": partial(hmcvt.identify, samples)}
        times = in_turns(2 if quick else 11, fit)["ours"]
        goals.append(
            at_most(f"identification of {count} samples", spread(times), limit, " s")
        )
    rows = []
    for case in CASES:
        found = [
            hmcvt.identify(samples_of(case), seed=seed)
            for seed in range(4 if quick else SEEDS)
        ]
        lowest = min(each.objective for each in found)
        off = [each.annealing_objective / lowest for each in found]
        near = sum(value <= NEAR for value in off)
        goals.append(
            Goal(
                f"{case}: the annealing alone ends within {100 * (NEAR - 1):.0f} % of the lowest "
                "objective",
                "every seed",
                f"{near} of {len(off)} seeds",
                near == len(off),
            )
        )
        rows.append(
            (
                case,
                *(
                    f"{100 * (value - 1):.2g} %"
                    for value in (
                        np.median(off),
                        max(off),
                        max(each.objective for each in found) / lowest,
                    )
                ),
                found[0].evaluations,
            )
        )
    head = (
        "samples",
        "annealing alone, median",
        "at most",
        "finished, at most",
        "candidates",
    )
    return Section(goals, {"searches": table(head, rows)})

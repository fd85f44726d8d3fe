# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification beside SciPy's global searches, the annealing by itself, and the diagnosis."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy import optimize

import hmcvt_core as hmcvt
from hmcvt_core.identification.problem import Problem
from hmcvt_core.transmission.parameters import SEARCH_BOUNDS
from studies.blind.campaign import make_campaign
from studies.page import Goal, spread, table

from .timing import Section, at_most, in_turns

FIT = np.array([1, 2, 4, 5, 6]) - 1  # section 4.2 of the paper
CASES: dict[str, tuple[str, Any]] = {
    "5 samples of Table 2": ("table2", FIT), "all 8 samples of Table 2": ("table2", slice(None)),
    "96 simulated samples": ("simulated", slice(None))}
SEEDS, NEAR = 100, 1.01
LIMIT = 0.25  # s, for 96 samples
SIZES = (24, 96, 384, 1536)

_RIVAL_SEEDS = 5
_FAR = 1e9  # objective where the model has no answer


def samples_of(case: str) -> hmcvt.BenchSamples:
    """Read the samples of a case."""
    file, chosen = CASES[case]
    samples = hmcvt.read_bench(hmcvt.data_path(f"data/{file}.csv"))
    return samples.select(np.arange(len(samples))[chosen])


def section(model: hmcvt.EfficiencyModel, quick: bool) -> Section:
    """Time and check all of it."""
    largest = samples_of("96 simulated samples")
    times = in_turns(2 if quick else 11, {"ours": partial(hmcvt.identify, largest)})["ours"]
    goals = [at_most("identification of 96 samples", spread(times), LIMIT, " s")]
    rows = []
    for case in CASES:
        found = [hmcvt.identify(samples_of(case), seed=seed)
                 for seed in range(4 if quick else SEEDS)]
        lowest = min(each.objective for each in found)
        off = [each.annealing_objective / lowest for each in found]
        near = sum(value <= NEAR for value in off)
        goals.append(Goal(
            f"{case}: the annealing alone ends within {100 * (NEAR - 1):.0f} % of the lowest "
            "objective", "every seed", f"{near} of {len(off)} seeds", near == len(off)))
        rows += [[case, "`hmcvt.identify`, annealing alone",
                  f"{100 * (np.median(off) - 1):.2g} %", f"{100 * (max(off) - 1):.2g} %",
                  f"{found[0].evaluations}", ""],
                 [case, "`hmcvt.identify`", *_above([each.objective for each in found], lowest),
                  "", "1"],
                 *_rivals(model, case, lowest, 1 if quick else _RIVAL_SEEDS)]
    head = ("samples", "search", "above, median", "at most", "candidates", "time / ours")
    return Section(goals, {"searches": table(head, rows), "diagnoses": _diagnosis(model, quick)})


def _above(values: list[float], lowest: float) -> list[str]:
    return [f"{100 * (value / lowest - 1):.2g} %" for value in (np.median(values), max(values))]


def _rivals(
    model: hmcvt.EfficiencyModel, case: str, lowest: float, seeds: int
) -> list[list[str]]:
    """One row for each of SciPy's searches."""
    samples = samples_of(case)
    problem = Problem(model, samples)

    def value(scaled: Any) -> Any:
        return np.nan_to_num(problem.objective(scaled), nan=_FAR)

    searches: dict[str, Callable[[int], Any]] = {
        "`dual_annealing`": lambda seed: optimize.dual_annealing(
            lambda scaled: float(value(scaled)), SEARCH_BOUNDS, rng=seed),
        "`differential_evolution`, vectorised": lambda seed: optimize.differential_evolution(
            lambda columns: value(columns.T), SEARCH_BOUNDS, rng=seed, vectorized=True,
            updating="deferred"),
    }
    rows = []
    for name, search in searches.items():
        found, times = [], []
        for seed in range(seeds):
            start = time.perf_counter()
            hmcvt.identify(samples, seed=seed)
            between = time.perf_counter()
            found.append(search(seed))
            times.append((time.perf_counter() - between) / (between - start))
        rows.append([case, f"SciPy {name}", *_above([float(each.fun) for each in found], lowest),
                     f"{np.median([each.nfev for each in found]):.0f}", spread(times).text(".3g")])
    return rows


def _diagnosis(model: hmcvt.EfficiencyModel, quick: bool) -> str:
    """`hmcvt.diagnose` by the number of samples."""
    rows = []
    for count in SIZES[:2] if quick else SIZES:
        campaign = make_campaign(1, (("charge_pump", 0.015),), samples=count)
        samples = hmcvt.BenchSamples(**campaign.samples)
        times = in_turns(1 if quick else 3, {"ours": partial(hmcvt.diagnose, model, samples)})
        rows.append([f"{count:,}", spread(times["ours"]).text(".2g")])
    return table(("samples", "seconds"), rows)

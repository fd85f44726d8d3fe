# SPDX-License-Identifier: Apache-2.0
"""Identification against the optimisers of three libraries, to the same value of the objective."""

from __future__ import annotations

import time

import numpy as np
import pytest

import hmcvt_core as hmcvt

from .searches import SEARCHES, Recorder, lowest_known
from .turns import QUICK

WITHIN = 1e-4
"""The value to reach: so much above the lowest that anyone finds, relative."""

FIT = np.array([1, 2, 4, 5, 6]) - 1  # section 4.2 of the paper
CASES = {
    "5 samples of Table 2": ("table2", FIT),
    "all 8 samples of Table 2": ("table2", slice(None)),
    "96 simulated samples": ("simulated", slice(None)),
}
# The searches take turns from seed to seed.
_RUNS = [(search, seed) for seed in range(2 if QUICK else max(item.seeds for item in SEARCHES))
         for search in SEARCHES if seed < search.seeds]


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Name, samples and lowest value of a case; everything that runs has run once before."""
    file, chosen = CASES[request.param]
    samples = hmcvt.read_bench(hmcvt.data_path(f"data/{file}.csv"))
    samples = samples.select(np.arange(len(samples))[chosen])
    for search in SEARCHES:
        search.run(Recorder(0.0, time.perf_counter).problem(), samples, 1_000)
    return request.param, samples, lowest_known(samples)


@pytest.mark.parametrize(("search", "seed"), _RUNS,
                         ids=lambda item: str(getattr(item, "name", item)))
def bench_identify(timed, case, search, seed):
    name, samples, lowest = case
    recorder = Recorder(lowest * (1.0 + WITHIN), time.perf_counter)
    problem = recorder.problem()
    begun = time.perf_counter()
    timed(lambda: search.run(problem, samples, seed), rounds=1, warm=False)
    reached = recorder.reached
    timed.told.update(
        case=name, search=search.name, kind=search.kind, seed=seed, value=recorder.lowest,
        lowest=lowest, evaluations=recorder.evaluations,
        reached_evaluations=reached and reached[0],
        reached_seconds=reached and reached[1] - begun)

# SPDX-License-Identifier: Apache-2.0
"""Diagnosis: time against the number of samples and of candidate effects, beside a refit."""

from __future__ import annotations

from functools import cache, partial

import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches import transmission
from hmcvt_core.physics.effects import library
from hmcvt_core.physics.effects.drag import ChargePump
from tests.diagnosis.campaigns import BASE, campaign

from .turns import QUICK, in_turns

TURNS = 3
SIZES = (24, 96, 384, 1536)
LARGEST = 10_000  # a single run
USUAL = 96
KINDS = tuple(len(library()) * part // 4 for part in (1, 2, 4))


@cache
def samples(count: int) -> hmcvt.BenchSamples:
    """A campaign with a charge pump that the model does not know."""
    return campaign((ChargePump(8.0),), seed=1, n=count)


@pytest.fixture(scope="module", autouse=True)
def imported():
    """What is imported or worked out at the first call is in no time."""
    for contender in ("diagnose", "identify"):
        _work(contender, SIZES[0])()


def _work(contender: str, count: int):
    return (partial(hmcvt.diagnose, BASE, samples(count)) if contender == "diagnose"
            else partial(hmcvt.identify, samples(count)))


@in_turns(TURNS, work=[(contender, count) for count in SIZES
                       for contender in ("diagnose", "identify")])
def bench_samples(timed, work, turn):
    contender, count = work
    timed.told.update(contender=contender, count=count)
    timed(_work(*work), rounds=1, warm=False)


@pytest.mark.skipif(QUICK, reason="takes long")
@pytest.mark.parametrize("contender", ["diagnose", "identify"])
def bench_largest(timed, contender):
    timed.told.update(contender=contender, count=LARGEST)
    found = timed(_work(contender, LARGEST), rounds=1, warm=False)
    if contender == "diagnose":
        assert "charge_pump" in [cause.effect for cause in found.causes]


@in_turns(TURNS, kinds=KINDS)
def bench_candidates(timed, monkeypatch, kinds, turn):
    """The same campaign with a part of the library of effects."""
    known = library()
    # Every n-th, so that each part has effects of every sort.
    chosen = known[::len(known) // kinds][:kinds]
    monkeypatch.setattr(transmission, "library", lambda: chosen)
    timed(_work("diagnose", USUAL), rounds=1, warm=False)

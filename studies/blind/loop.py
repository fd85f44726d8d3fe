# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The loop that asks: a small campaign, then test by test, until the diagnosis has enough."""

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from studies.blind.campaign import Campaign, fresh
from studies.blind.conditions import LISTED, LOOP, Case, draw
from studies.blind.effect import FloatArray
from studies.blind.hydrostatics import NOMINAL_TEMPERATURE
from studies.blind.trial import AXES, at_hand, hidden, score
from studies.blind.twin import OperatingPoints

FEW, MOST = 24, 48
"""Samples to begin with, and tests made beyond them before the loop counts as not settled."""
_LOOKS = (-1, 0, 2, 4, 7, 11, 16, 24, 34, MOST)
_START, _RANDOM = 2**40, 2**41  # seeds of the first samples and of those at random


def work(case: Case) -> dict[str, Any]:
    """Make what a case asks for: one diagnosis, or a loop."""
    return play(case) if case.condition == LOOP else score(case)


def play(case: Case) -> dict[str, Any]:
    """Make tests as they are asked for, and in another run at random, until they are enough."""
    campaign, seconds = draw(case), list[float]()
    few = fresh(campaign, case.seed + _START, samples=FEW)
    return {
        **hidden(case, campaign),
        "asked": _end(_asked(few, case.seed, seconds), case, few),
        "random": _end(_at_random(few, case.seed), case, few),
        "seconds": max(seconds),
    }


def _end(
    run: Iterator[tuple[float, Any]], case: Case, campaign: Campaign
) -> dict[str, Any]:
    *_, (tests, advice) = run
    alive = [
        (sorted(each["effects"]), each["probability"]) for each in advice["alive"][:3]
    ]
    settled, truth = advice["reason"] == "settled", sorted(campaign.bench.names)
    return {
        "tests": tests,
        "reason": advice["reason"],
        "alive": alive,
        "settled": settled,
        "right": settled and case.group in LISTED and alive[0][0] == truth,
    }


def _advice(campaign: Campaign) -> Any:
    noise = campaign.bench.options.efficiency_noise
    return hmcvt.next_test(*at_hand(campaign), noise=noise).to_dict()


def _asked(
    campaign: Campaign, seed: int, seconds: list[float]
) -> Iterator[tuple[float, Any]]:
    """Make the test that is asked for, again and again."""
    rng = np.random.default_rng([seed, 19])
    for tests in range(MOST + 1):
        start = time.process_time()
        advice = _advice(campaign)
        seconds.append(time.process_time() - start)
        yield tests, advice
        if advice["test"] is None:
            return
        stroke, speed, torque = (np.array([advice["test"][axis]]) for axis in AXES)
        swing = campaign.bench.options.temperature_swing or 0.0
        warm = NOMINAL_TEMPERATURE + swing * rng.uniform(-1.0, 1.0, 1)
        point = OperatingPoints(stroke, speed, torque, warm)
        test = campaign.bench.measure(int(rng.integers(2**62)), point)
        campaign = _joined(campaign, test.samples)


def _at_random(campaign: Campaign, seed: int) -> Iterator[tuple[float, Any]]:
    """Make tests at random till all is settled; count the middle between two looks."""
    more = fresh(campaign, seed + _RANDOM, samples=MOST)
    for before, tests in pairwise(_LOOKS):
        part = {name: values[:tests] for name, values in more.samples.items()}
        advice = _advice(_joined(campaign, part))
        yield 0.5 * (before + 1 + tests), advice
        if advice["reason"] == "settled":
            return


def _joined(campaign: Campaign, more: dict[str, FloatArray]) -> Campaign:
    return replace(
        campaign,
        samples={
            name: np.concatenate([values, more[name]])
            for name, values in campaign.samples.items()
        },
    )

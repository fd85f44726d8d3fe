# SPDX-License-Identifier: Apache-2.0
"""Which campaigns a blind trial makes: the reference conditions, a grid around them, stress."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from hmcvt_core.blind.catalogue import KNOWN_EFFECTS, UNKNOWN_EFFECTS
from hmcvt_core.blind.trial import Case

REFERENCE = "reference"
_NOISES = (0.002, 0.004, 0.011)
_SAMPLES = (24, 48, 96)
_SHIFTS = (0.007, 0.03)  # of the efficiency, drawn evenly in its logarithm
_NONE_PER_EFFECT = 10  # campaigns without effect for each seed of the single effects
_SEEDS = {REFERENCE: 10_000, "grid": 20_000, "stress": 30_000}

STRESS: dict[str, dict[str, Any]] = {
    "noise stated at half": {"stated_noise_factor": 0.5},
    "noise stated at 1.5": {"stated_noise_factor": 1.5},
    "heavy tails": {"heavy_tails": True},
    "one outlier": {"outliers": 1},
    "session gain 0.3 %": {"session_gain_std": 0.003, "sessions": 4},
    "oil temperature varies": {"vary_temperature": True},
    "base off": {"base_off": True},
    "factorial plan": {"plan": "factorial"},
    "constant power": {"plan": "constant_power"},
}


def cases(seeds: int) -> list[Case]:
    """Return every case of a trial.

    Args:
        seeds: campaigns per single effect in the reference conditions; the grid and each stress
            take a third of that.
    """
    fewer = max(1, seeds // 3)
    found = list(_condition(REFERENCE, {}, seeds, _SEEDS[REFERENCE], pairs=True))
    for noise, count, speed in product(_NOISES, _SAMPLES, (0.001, None)):
        options = {"efficiency_noise": noise, "samples": count, "output_speed_noise": speed}
        name = f"{100 * noise:g} %, {count}, {'with' if speed else 'without'} speed"
        found += _condition(name, options, fewer, _SEEDS["grid"])
    for name, options in STRESS.items():
        found += _condition(name, options, fewer, _SEEDS["stress"])
    return found


def _condition(
    name: str, options: dict[str, Any], seeds: int, first: int, pairs: bool = False
) -> Iterator[Case]:
    for effect in (*KNOWN_EFFECTS, *UNKNOWN_EFFECTS):
        for seed in range(first, first + seeds):
            yield _case(name, seed, (effect,), options)
    for seed in range(first, first + _NONE_PER_EFFECT * seeds):
        yield _case(name, seed, (), options)
    if pairs:
        for seed in range(first, first + 2 * seeds):
            rng = np.random.default_rng([seed, 7])
            chosen = rng.choice(len(KNOWN_EFFECTS), 2, replace=False)
            yield _case(name, seed, tuple(KNOWN_EFFECTS[i] for i in chosen), options)


def _case(name: str, seed: int, effects: tuple[str, ...], options: dict[str, Any]) -> Case:
    rng = np.random.default_rng([seed, len(effects), 11])
    low, high = np.log(_SHIFTS)
    sized = tuple((effect, float(np.exp(rng.uniform(low, high)))) for effect in effects)
    if "oil_temperature" in effects:
        options = {**options, "vary_temperature": True}
    return Case(name, seed, sized, tuple(sorted(options.items())))

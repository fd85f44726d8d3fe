# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which campaigns a blind trial makes: the reference conditions, a grid around them, stress."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from studies.blind.catalogue import KNOWN_EFFECTS, UNKNOWN_EFFECTS
from studies.blind.trial import Case

REFERENCE = "reference"
PARTS = (REFERENCE, "grid", "stress")
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


def cases(seeds: int, side_seeds: int, parts: Sequence[str] = PARTS) -> list[Case]:
    """Return the cases of a trial.

    Args:
        seeds: campaigns per single effect in the reference conditions.
        side_seeds: the same in each condition of the grid and each stress.
        parts: which of `PARTS` to make.
    """
    found: list[Case] = []
    if REFERENCE in parts:
        found += _condition(REFERENCE, {}, seeds, _SEEDS[REFERENCE], pairs=True)
    if "grid" in parts:
        found += _grid(side_seeds)
    if "stress" in parts:
        for name, options in STRESS.items():
            found += _condition(name, options, side_seeds, _SEEDS["stress"])
    return found


def _grid(seeds: int) -> Iterator[Case]:
    for noise, count, speed in product(_NOISES, _SAMPLES, (0.001, None)):
        options = {"efficiency_noise": noise, "samples": count, "output_speed_noise": speed}
        name = f"{100 * noise:g} %, {count}, {'with' if speed else 'without'} speed"
        yield from _condition(name, options, seeds, _SEEDS["grid"])


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

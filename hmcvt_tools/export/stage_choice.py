# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The choice of the stage with hysteresis as C, with answers of Python as its self-test."""

from __future__ import annotations

import math

import numpy as np

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.ranges import Array
from hmcvt_core.transmission.stage import speed_ratio

from .c_model import template

HEADER = "hmcvt_stage.h"
SOURCE = "hmcvt_stage.c"
CHECK = "check_stage.c"
VECTORS = "stage_vectors.csv"
COLUMNS = (
    "engaged",
    "hysteresis",
    "output_speed",
    "output_power",
    "lowest_engine_speed",
    "highest_engine_speed",
    "stage",
)
HYSTERESIS = (0.0, 0.02, 0.1)
_DEMANDS = 60
_POWERS = (3e3, 90e3)
_SEED = 57
_MARGIN = 1e-6
"""Change of the hysteresis that must not change a vector: compilers round in another order."""


def stage_choice_files(model: EfficiencyModel, with_tables: bool) -> dict[str, str]:
    """Return the files of the choice by name; none for a model of one stage.

    Args:
        model: of several stages.
        with_tables: whether tables stand for effects. Their error may change a choice, so that
            there are no vectors and no self-test then.
    """
    if len(model.stages) == 1:
        return {}
    files = stage_choice_sources(model.fingerprint)
    if not with_tables:
        files[CHECK] = template(CHECK).substitute(fingerprint=model.fingerprint)
        files[VECTORS] = _vectors(model)
    return files


def stage_choice_sources(fingerprint: str) -> dict[str, str]:
    """Return header and source of the choice by name."""
    return {
        name: template(name).substitute(fingerprint=fingerprint)
        for name in (HEADER, SOURCE)
    }


def random_demands(model: EfficiencyModel, count: int, seed: int) -> Array:
    """Return output speeds and powers over all stages, shape (count, 2).

    Args:
        model: of several stages.
        count: of demands.
        seed: of the random numbers.
    """
    random = np.random.default_rng(seed)
    low, high = ranges.ENGINE_SPEED_LIMITS
    stages = [part.stage for part in model.stages.values()]
    speeds = []
    for number in random.integers(len(stages), size=count):
        ratio = speed_ratio(stages[number], random.uniform(-1.0, 1.0, 1))[0]
        speed = float(ratio) * random.uniform(low, high)
        least = ranges.OUTPUT_SPEED.low
        speeds.append(speed if abs(speed) >= least else least)
    least_power, highest_power = _POWERS
    powers = np.exp(
        random.uniform(math.log(least_power), math.log(highest_power), count)
    )
    # What a float holds, so that single precision reads the same demand.
    demands = np.column_stack([speeds, powers]).astype(np.float32)
    return demands.astype(float)


def _vectors(model: EfficiencyModel) -> str:
    """Return the choices of Python along random demands, each from the stage chosen before."""
    names = list(model.stages)
    limits = np.array(ranges.ENGINE_SPEED_LIMITS, dtype=np.float32)
    low = float(limits[0])
    high = float(limits[1])
    lines = [",".join(COLUMNS)]
    engaged = -1
    for number, (speed, power) in enumerate(
        random_demands(model, _DEMANDS, _SEED).tolist()
    ):
        hysteresis = HYSTERESIS[number % len(HYSTERESIS)]
        chosen = set()
        for part in (hysteresis, hysteresis * (1.0 - _MARGIN), hysteresis + _MARGIN):
            best = model.optimal_drive(
                speed,
                power,
                engine_speed_limits=(low, high),
                stage=None if engaged < 0 else names[engaged],
                hysteresis=part,
            )
            chosen.add(-1 if best.stage is None else names.index(best.stage))
        if len(chosen) > 1:
            continue
        (stage,) = chosen
        row = (engaged, hysteresis, speed, power, low, high, stage)
        lines.append(",".join(map(repr, row)))
        engaged = stage
    return "\n".join(lines) + "\n"

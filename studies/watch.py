# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt watch` on simulated streams: false alarms without a gap, delay where one opens.

    python -m studies.watch [--streams 200] [--seed 0]

The unit of a stream differs from its model as the model's standard errors say, and by a smooth
error of the form of 0.12 points. A gap is one of three physical losses, sized to a mean.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hmcvt_core import (
    BenchSamples,
    EfficiencyModel,
    HydraulicParameters,
    data_path,
    load_model,
)
from hmcvt_core.monitoring import Opening, Watch
from hmcvt_core.physics.effects.base import Effect
from hmcvt_core.physics.effects.mechanical import ChargePump, Churning
from studies.page import table

Array = NDArray[np.float64]
NOISE = 0.004
MISFIT = 0.0012
SAMPLES, OPENS = 300, 100
SIZES = (0.0025, 0.005, 0.01, 0.02, 0.04)
# Torque ~ constant, torque ~ speed^2, and a meter that has drifted.
GAPS: dict[str, Callable[[EfficiencyModel], EfficiencyModel] | None] = {
    "charge_pump": lambda model: _with(model, ChargePump(torque=1.0)),
    "churning": lambda model: _with(model, Churning(torque=1.0)),
    "step": None,
}


def well_known() -> EfficiencyModel:
    """The shipped model as some 60 tests would have identified it: a tenth of its errors."""
    model = load_model(data_path("params/hm4.yaml"))
    return replace(
        model,
        standard_errors={
            name: error / 10.0 for name, error in model.standard_errors.items()
        },
    )


def stream(
    model: EfficiencyModel,
    seed: int,
    gap: str = "",
    size: float = 0.0,
    noise: float = NOISE,
    samples: int = SAMPLES,
) -> BenchSamples:
    """Bench samples of a unit that the model is of; a gap of mean `size` opens at `OPENS`."""
    rng = np.random.default_rng(seed)
    errors = np.array(list(model.standard_errors.values()))
    drawn = rng.multivariate_normal(
        model.parameters.to_array() / errors, model.correlation
    )
    unit = replace(
        model, parameters=HydraulicParameters(*np.maximum(drawn * errors, 1e-14))
    )
    point = (
        rng.uniform(-1.0, 1.0, samples),
        rng.uniform(80.0, 220.0, samples),
        rng.uniform(60.0, 350.0, samples),
    )
    wave = np.sin(
        np.stack([point[0] * 3.0, point[1] / 40.0, point[2] / 80.0])
        + rng.uniform(0.0, 6.28, (3, 1))
    ).sum(axis=0) * np.sqrt(2.0 / 3.0)
    true = unit.efficiency(*point) + MISFIT * wave
    change = GAPS.get(gap)
    lost = (
        np.ones(samples)
        if change is None
        else (unit.efficiency(*point) - change(unit).efficiency(*point))
    )
    true = true - size * lost / lost.mean() * (np.arange(samples) >= OPENS)
    return BenchSamples(
        *point, np.clip(true + noise * rng.standard_normal(samples), 0.02, 1.0)
    )


def watched(
    model: EfficiencyModel, samples: BenchSamples, noise: float = NOISE
) -> Opening:
    """What a watch says at the end of a stream."""
    running = Watch(model, noise)
    running.take(samples)
    return running.result


def _with(model: EfficiencyModel, effect: Effect) -> EfficiencyModel:
    return replace(model, effects=(*model.effects, effect))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--streams", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    given: Any = parser.parse_args()
    model, seeds = well_known(), range(given.seed, given.seed + given.streams)
    alarms = [
        (
            f"{factor:g}",
            sum(
                watched(model, stream(model, seed, noise=factor * NOISE)).open
                for seed in seeds
            ),
        )
        for factor in (1.0, 1.25, 1.5)
    ]
    print(
        table(
            (
                "without a gap, noise true / stated",
                f"false alarms in {given.streams} streams",
            ),
            alarms,
        ),
        end="\n\n",
    )
    rows = []
    for gap, size in product(GAPS, SIZES):
        found = [watched(model, stream(model, seed, gap, size)) for seed in seeds]
        told = [each for each in found if (each.noticed or 0) > OPENS]
        delay = [(each.noticed or 0) - OPENS for each in told] or [np.nan]
        held = [
            each.interval[0] <= -size <= each.interval[1]
            for each in told
            if each.interval
        ]
        median = np.median([each.size for each in told if each.size] or [np.nan])
        rows.append(
            (
                gap,
                f"{100 * size:g}",
                f"{100 * len(told) / len(found):.0f} %",
                sum(each.open for each in found) - len(told),
                f"{np.median(delay):.0f} ({np.quantile(delay, 0.9):.0f})",
                f"{100 * median:+.2f}",
                f"{100 * np.mean(held or [np.nan]):.0f} %",
            )
        )
    print(
        table(
            (
                "gap",
                "size [points]",
                "noticed",
                "before it opened",
                "delay, median (90 %) [samples]",
                "reported size, median",
                "interval contains it",
            ),
            rows,
        )
    )


if __name__ == "__main__":
    main()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One campaign, test by test: the diagnosis asks, a simulated bench measures, until it is settled.

    python examples/next_test.py

The plant is the shipped model with an effect that the diagnosis is not told. On a bench of yours,
`hmcvt next bench.csv` tells which test to add to the file.
"""

from dataclasses import replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.transmission.ranges import RPM, OperatingPoints

EFFICIENCY_NOISE, SPEED_NOISE = 0.004, 0.001
STARTED, MOST = 24, 12  # tests before the first question, tests asked for
COLUMNS = (
    "displacement_ratio",
    "engine_speed",
    "load_torque",
    "efficiency",
    "output_speed",
)

MODEL = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
PLANT = replace(MODEL, effects=(PressureLeakage(6e-12),))


def measure(points: OperatingPoints, rng: np.random.Generator) -> hmcvt.BenchSamples:
    """Read efficiency and output speed of the plant."""
    efficiency, speed, _ = PLANT.readings_at(points)
    read = (
        efficiency + EFFICIENCY_NOISE * rng.standard_normal(efficiency.shape),
        speed * (1.0 + SPEED_NOISE * rng.standard_normal(speed.shape)),
    )
    return hmcvt.BenchSamples(**dict(zip(COLUMNS, (*points[:3], *read), strict=True)))


def joined(*parts: hmcvt.BenchSamples) -> hmcvt.BenchSamples:
    """Put campaigns one after another."""
    return hmcvt.BenchSamples(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in COLUMNS
        }
    )


def main() -> None:
    """Ask and measure."""
    rng = np.random.default_rng(2)
    engine = rng.uniform(80.0, 220.0, STARTED)
    samples = measure(
        OperatingPoints(
            rng.uniform(-0.9, 0.9, STARTED),
            engine,
            rng.uniform(18e3, 40e3, STARTED) / engine,
        ),
        rng,
    )
    for _ in range(MOST + 1):
        advice = hmcvt.next_test(MODEL, samples, noise=EFFICIENCY_NOISE)
        alive = [
            f"{' + '.join(names) or 'unlisted'} {100 * p:.0f} %"
            for names, p in advice.alive[:3]
        ]
        print(
            f"{len(samples)} tests: {', '.join(alive)}, no gap {100 * advice.no_gap:.0f} %"
        )
        if advice.stop:
            print(
                f"stop: {advice.reason}{f'; {advice.measure}' if advice.measure else ''}"
            )
            return
        point = advice.tests[0].point
        print(
            f"  next: stroke {point['displacement_ratio']:+.2f}, "
            f"{point['engine_speed'] / RPM:.0f} r/min, {point['load_torque']:.0f} N m; about "
            f"{advice.tests_expected} more"
        )
        asked = OperatingPoints(*(np.array([point[name]]) for name in COLUMNS[:3]))
        samples = joined(samples, measure(asked, rng))


if __name__ == "__main__":
    main()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Run a campaign test by test: the advice chooses each test, a simulated bench measures it.

    python examples/next_test.py

The plant is the shipped model with an effect that is unknown to the diagnosis. On your bench,
`hmcvt next bench.csv` names the test to add to the file.
"""

from dataclasses import replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.transmission.ranges import RPM, OperatingPoints

EFFICIENCY_NOISE = 0.004
SPEED_NOISE = 0.001
FIRST_TESTS = 24
MAX_FURTHER_TESTS = 12
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
    readings = PLANT.readings_at(points)
    efficiency = readings["efficiency"]
    speed = readings["output_speed"]
    return hmcvt.BenchSamples(
        displacement_ratio=points.displacement_ratio,
        engine_speed=points.engine_speed,
        load_torque=points.load_torque,
        efficiency=efficiency
        + EFFICIENCY_NOISE * rng.standard_normal(efficiency.shape),
        output_speed=speed * (1.0 + SPEED_NOISE * rng.standard_normal(speed.shape)),
    )


def joined(*parts: hmcvt.BenchSamples) -> hmcvt.BenchSamples:
    """Return campaigns one after another."""
    return hmcvt.BenchSamples(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in COLUMNS
        }
    )


def main() -> None:
    """Follow the advice until it says stop."""
    rng = np.random.default_rng(1)
    engine = rng.uniform(80.0, 220.0, FIRST_TESTS)
    samples = measure(
        OperatingPoints(
            rng.uniform(-0.9, 0.9, FIRST_TESTS),
            engine,
            rng.uniform(18e3, 40e3, FIRST_TESTS) / engine,
        ),
        rng,
    )
    for _ in range(MAX_FURTHER_TESTS + 1):
        advice = hmcvt.next_test(MODEL, samples, noise=EFFICIENCY_NOISE)
        explanations = [
            f"{' + '.join(names) or 'unlisted'} {100 * probability:.0f} %"
            for names, probability in advice.candidates[:3]
        ]
        print(
            f"{len(samples)} tests: {', '.join(explanations)}, "
            f"no gap {100 * advice.no_gap:.0f} %"
        )
        if advice.stop:
            print(f"stop: {advice.reason}")
            if advice.measure:
                print(f"measure: {advice.measure}")
            return
        point = advice.tests[0].point
        print(
            f"  next: stroke {point['displacement_ratio']:+.2f}, "
            f"{point['engine_speed'] / RPM:.0f} r/min, {point['load_torque']:.0f} N m; about "
            f"{advice.tests_expected} more"
        )
        requested = OperatingPoints(*(np.array([point[name]]) for name in COLUMNS[:3]))
        samples = joined(samples, measure(requested, rng))


if __name__ == "__main__":
    main()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The hidden losses of all trial plants lose power; none gives any."""

import numpy as np
import pytest

from studies.blind import hydrostatics, unknown
from studies.blind.bench import listed_losses, unlisted_losses
from studies.blind.bench.plant import BenchConditions
from studies.blind.effect import Effect
from studies.blind.renewed import listed, unlisted

PLANTS = (hydrostatics, unknown, listed_losses, unlisted_losses, listed, unlisted)
LOSSES = [
    kind
    for module in PLANTS
    for kind in vars(module).values()
    if isinstance(kind, type)
    and issubclass(kind, Effect)
    and kind.__module__ == module.__name__
    and kind.lost_flow is not Effect.lost_flow
    and kind is not unknown.BaseMisfit  # a field of either sign
]


def _conditions(rng, count=2000):
    """Draw states with either sense of stroke, motor and pressure."""
    values = {
        "command": rng.uniform(-1.0, 1.0, count),
        "engine_speed": rng.uniform(80.0, 230.0, count),
        "pump_speed": rng.uniform(0.0, 400.0, count),
        "motor_speed": rng.uniform(-400.0, 400.0, count),
        "carrier_speed": rng.uniform(0.0, 300.0, count),
        "output_speed": rng.uniform(1.0, 300.0, count),
        "pressure": rng.uniform(-35e6, 35e6, count),
        "load_torque": rng.uniform(10.0, 500.0, count),
        "gap_viscosity": rng.uniform(0.3, 4.0, count),
        "film_viscosity": rng.uniform(0.3, 4.0, count),
        "oil_temperature": rng.uniform(10.0, 100.0, count),
        "approach": rng.choice([-1.0, 1.0], count),
        "load_power": rng.uniform(1e3, 1e5, count),
    }
    return BenchConditions(
        **values,
        stroke=values["command"],
        pump_displacement=8.75e-6,
        motor_displacement=8.75e-6,
        leakage=2.1e-11,
    )


@pytest.mark.parametrize(
    "kind", LOSSES, ids=lambda kind: f"{kind.__module__}.{kind.name}"
)
def test_a_lost_flow_follows_the_pressure(kind):
    rng = np.random.default_rng(5)
    at = _conditions(rng)
    for variant in kind.variants or ("",):
        effect = kind(variant=variant).drawn(rng)
        assert np.all(effect.lost_flow(at) * at.pressure >= 0.0)

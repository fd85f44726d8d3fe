# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnose another machine on a bench: a fan whose bearing drags.

    python examples/own_system.py

The diagnosis works on any `hmcvt.System`: axes, channels, base parameters, effects, a prediction.
The base model of this fan has two parameters, disc friction (power = k speed^3) and the pressure at
no flow. Bearing drag and a slipping belt are effects that it may be missing.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

import hmcvt_core as hmcvt

SPEED = hmcvt.Axis.of("speed", "rad/s", digits=0)
FLOW = hmcvt.Axis.of("flow", "m3/s")
EFFICIENCY = hmcvt.Channel(
    name="efficiency",
    unit="points",
    factor=100.0,  # from a fraction to points
    digits=2,
    uncertainty=0.005,
    relative=False,
    field_spreads=(0.003, 0.01, 0.03),  # sizes of an unlisted loss that is smooth
    step_spreads=(0.01, 0.03),  # and of one inside a region
    misfit_spread=0.0005,  # smooth error of the base model that is no cause
)
NOISE = {"efficiency": 0.002}  # standard deviation of the readings


@dataclass(frozen=True)
class BearingDrag(hmcvt.SystemEffect):
    """Constant torque of the bearing."""

    name = "bearing_drag"
    component = "bearing"
    summary = "the bearing drags with a constant torque"
    remedy = "spin the shaft without the wheel"
    torque: float = hmcvt.size("N m", 0.1, 0.0, 2.0, "drag torque")


@dataclass(frozen=True)
class BeltSlip(hmcvt.SystemEffect):
    """Part of the power that a slipping belt takes."""

    name = "belt_slip"
    component = "belt"
    summary = "the belt slips and takes a part of the power"
    remedy = "measure the speed of both pulleys"
    part: float = hmcvt.size("-", 0.02, 0.0, 0.3, "part of the power")


def parameters(scaled: hmcvt.Array) -> hmcvt.Array:
    """Return disc friction and pressure coefficient of scaled variables, shape (2,)."""
    friction, pressure = scaled
    return np.array([1e-5 * friction, 0.08 * (1.0 + 0.01 * pressure)])


class Fan:
    """A fan on a bench as a `hmcvt.System`."""

    axes: tuple[hmcvt.Axis, ...] = (SPEED, FLOW)
    channels: tuple[hmcvt.Channel, ...] = (EFFICIENCY,)
    library: tuple[Any, ...] = (BearingDrag(), BeltSlip())
    refusal = "ask for a flow that the fan cannot deliver"
    advice = "check the unit of the flow"
    base = hmcvt.BaseParameters(
        names=("disc_friction", "pressure_coefficient"),
        mean=np.array([2.0, 0.0]),
        spread=np.array([1.0, 1.0]),
        low=np.array([0.0, -5.0]),
        high=np.array([20.0, 5.0]),
        values=parameters,
        units=("N m s2", "Pa s2"),
    )

    def predict(
        self, base: hmcvt.Array, effects: Any, points: hmcvt.Points
    ) -> hmcvt.Array:
        """Return the efficiency at n points, shape (1, n); NaN where there is none."""
        friction, coefficient = parameters(base)
        speed, flow = points["speed"], points["flow"]
        torque = friction * speed**2
        through_belt = 1.0
        for effect in effects:
            if isinstance(effect, BearingDrag):
                torque = torque + effect.torque
            if isinstance(effect, BeltSlip):
                through_belt = 1.0 - effect.part
        pressure = coefficient * speed**2 - 40.0 * flow**2
        power = (pressure * flow + torque * speed) / through_belt
        efficiency = np.where(pressure > 0.0, pressure * flow / power, np.nan)
        return efficiency[None, :]

    def candidates(self, points: hmcvt.Points, base: hmcvt.Array) -> hmcvt.Points:
        """Return the points that a test can ask for."""
        grid = np.meshgrid(np.linspace(60.0, 200.0, 8), np.linspace(0.3, 1.5, 7))
        return {"speed": grid[0].ravel(), "flow": grid[1].ravel()}

    def lost_power(
        self, points: hmcvt.Points, expected: hmcvt.Array, real: hmcvt.Array
    ) -> hmcvt.Array:
        """Return the shaft power lost by an efficiency below the expected one [W], (n,)."""
        pressure = 0.08 * points["speed"] ** 2 - 40.0 * points["flow"] ** 2
        return pressure * points["flow"] * (1.0 / real - 1.0 / expected)

    def model_of(
        self, base: hmcvt.Array, effects: Any, samples: Any, covariance: hmcvt.Array
    ) -> dict[str, Any]:
        """Return what is kept of a fit."""
        values = dict(zip(self.base.names, parameters(base), strict=True))
        return {**values, "effects": effects, "covariance": covariance}

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return notes on the samples."""
        return ()


def campaign(
    seed: int, tests: int = 60, **hidden: float
) -> tuple[dict[str, hmcvt.Array], dict[str, hmcvt.Array]]:
    """Return points and readings of a simulated fan with hidden effects."""
    rng = np.random.default_rng(seed)
    fan = Fan()
    effects = []
    for effect in fan.library:
        if effect.name in hidden:
            size = effect.sizes()[0].name
            effects.append(effect.with_values({size: hidden[effect.name]}))
    base = fan.base.mean + 0.5 * fan.base.spread * rng.standard_normal(len(fan.base))
    points = {
        "speed": rng.uniform(60.0, 200.0, tests),
        "flow": rng.uniform(0.3, 1.5, tests),
    }
    true = fan.predict(base, effects, points)[0]
    noise = NOISE["efficiency"] * rng.standard_normal(tests)
    return points, {"efficiency": true + noise}


def simulated() -> hmcvt.Observations:
    """Simulate a campaign on a fan whose bearing drags with 0.15 N m."""
    points, readings = campaign(seed=1, bearing_drag=0.15)
    return hmcvt.observe_system(Fan(), {**points, **readings}, noise=NOISE)


if __name__ == "__main__":
    print(hmcvt.diagnose_system(Fan(), simulated()).report())

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnose another machine on a bench: a fan whose bearing drags.

    python examples/own_system.py

The diagnosis works on any `System`: axes, channels, base parameters, effects and a
prediction. This one is a fan. Its efficiency depends on speed and flow; disc friction is
identified, bearing drag and a gap at the inlet are the effects that may be missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from hmcvt_core.diagnosis import diagnose_system
from hmcvt_core.diagnosis.observations import Observations
from hmcvt_core.diagnosis.system import Array, Axis, BaseParameters, Channel, Points
from hmcvt_core.physics.effects.base import EffectParameter, size

NOISE = 0.002
STATED = 8.0  # samples that the statement of the noise is worth
AXES = (
    Axis("speed", "rad/s", "speed", "speed [rad/s]", 0, 0.1),
    Axis("flow", "m3/s", "flow", "flow [m3/s]", 2, 0.01),
)
EFFICIENCY = Channel(
    name="efficiency",
    unit="points",
    factor=100.0,
    digits=2,
    uncertainty=0.005,
    relative=False,
    field_spreads=(0.003, 0.01, 0.03),
    step_spreads=(0.01, 0.03),
    misfit_spread=0.0005,
)


@dataclass(frozen=True)
class FanEffect:
    """A loss that the base model leaves out; its first field is the size."""

    name: ClassVar[str] = ""
    form: ClassVar[str] = ""
    component: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    source: ClassVar[str] = "textbook"
    remedy: ClassVar[str] = ""

    def parameters(self) -> tuple[EffectParameter, ...]:
        """Return the declared parameters."""
        return tuple(
            EffectParameter(item.name, **item.metadata) for item in fields(self)
        )

    sizes = parameters

    def values(self) -> dict[str, float]:
        """Return parameter values by name."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def with_values(self, values: dict[str, float]) -> FanEffect:
        """Return a copy with other values."""
        return replace(self, **values)


@dataclass(frozen=True)
class BearingDrag(FanEffect):
    """Constant torque of the bearing."""

    name = "bearing_drag"
    component = "bearing"
    summary = "the bearing drags with a constant torque"
    remedy = "spin the shaft without the wheel"
    torque: float = size("N m", 0.1, 0.0, 2.0, "drag torque")


@dataclass(frozen=True)
class InletGap(FanEffect):
    """Flow that returns from the outlet to the inlet."""

    name = "inlet_gap"
    component = "casing"
    summary = "air returns through the gap at the inlet"
    remedy = "measure the gap"
    flow: float = size("m3/s", 0.01, 0.0, 0.1, "flow that returns at 100 rad/s")


class Fan:
    """A fan on a bench as a `System`."""

    axes = AXES
    channels = (EFFICIENCY,)
    library = (BearingDrag(), InletGap())
    refusal = "ask for a flow that the fan cannot deliver"
    advice = "check the unit of the flow"
    # One parameter, the disc friction, in multiples of 1e-5 N m s2.
    base = BaseParameters(
        names=("disc_friction",),
        mean=np.array([2.0]),
        spread=np.array([1.0]),
        low=np.array([0.0]),
        high=np.array([20.0]),
        values=lambda scaled: 1e-5 * scaled,
    )

    def predict(
        self, base: Array, effects: Sequence[FanEffect], points: Points
    ) -> Array:
        """Return the efficiency at points, shape (1, n); NaN where there is none."""
        speed, flow = points["speed"], points["flow"]
        (friction,) = self.base.values(base)
        size_of = {
            effect.name: next(iter(effect.values().values())) for effect in effects
        }
        returning = size_of.get("inlet_gap", 0.0) * speed / 100.0
        pressure = 0.08 * speed**2 - 40.0 * flow**2
        power = pressure * (flow + returning) + friction * speed**3
        power = power + size_of.get("bearing_drag", 0.0) * speed
        efficiency = np.where(pressure > 0.0, pressure * flow / power, np.nan)
        return efficiency[None, :]

    def candidates(self, points: Points, base: Array) -> Points:
        """Return the points that a test can ask for."""
        speed, flow = np.meshgrid(np.linspace(60, 200, 8), np.linspace(0.3, 1.5, 7))
        return {"speed": speed.ravel(), "flow": flow.ravel()}

    def lost_power(self, points: Points, expected: Array, real: Array) -> Array:
        """Return the power lost beyond what is expected [W]."""
        useful = (0.08 * points["speed"] ** 2 - 40.0 * points["flow"] ** 2) * points[
            "flow"
        ]
        return useful * (1.0 / real - 1.0 / expected)

    def model_of(self, base: Array, effects: Sequence[FanEffect], samples: Any) -> Any:
        """Return what is kept of a fit."""
        return {"disc_friction": self.base.values(base), "effects": tuple(effects)}

    def remarks(self, samples: Any) -> tuple[str, ...]:
        """Return notes on the samples."""
        return ()


@dataclass(frozen=True)
class Record:
    """The samples as the fan's bench keeps them."""

    rows: Array
    source: str = "fan bench"

    def __len__(self) -> int:
        return len(self.rows)

    def select(self, index: Array) -> Record:
        """Return some of the samples."""
        return replace(self, rows=self.rows[index])


def observations(tests: int = 60) -> Observations:
    """Simulate a campaign on a fan whose bearing drags."""
    rng = np.random.default_rng(1)
    points = {
        "speed": rng.uniform(60.0, 200.0, tests),
        "flow": rng.uniform(0.3, 1.5, tests),
    }
    true = Fan().predict(np.array([2.0]), (BearingDrag(torque=0.15),), points)
    measured = true + NOISE * rng.standard_normal((1, tests))
    return Observations(
        AXES,
        points,
        (EFFICIENCY,),
        measured,
        np.full_like(measured, NOISE),
        np.array([STATED]),
        Record(measured.T),
        np.arange(tests),
        "stated",
    )


if __name__ == "__main__":
    print(diagnose_system(Fan(), observations()).report())

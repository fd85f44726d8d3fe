# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Models with effects whose export is tested: listed ones, a user's, and an empirical remainder."""

from dataclasses import dataclass, replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core import Effect, size
from hmcvt_core.physics.effects.hydraulic import PortPressureDrop
from hmcvt_core.physics.effects.mechanical import ChargePump, ClutchDrag
from hmcvt_tools.export.effect_tables import TABLE_LOAD, TABLE_SPEED

THREE_EFFECTS = (
    ChargePump(torque=4.0),
    ClutchDrag(torque=6.0),
    PortPressureDrop(drop=3e5),
)


class _Unlisted(Effect):
    """Base of effects of these tests alone: without a name of their own, none is in the library."""

    name = "export_test"
    component = "gears"
    summary = "made up"
    source = "made up"
    remedy = "none"


@dataclass(frozen=True)
class Seal(_Unlisted):
    """A seal that drags on the engine with a torque that rises with speed, then levels out."""

    torque: float = size("N m", 3.0, 0.0, 20.0, "drag at high speed")

    def engine_drag(self, state):
        return self.torque * np.tanh(state.engine_speed / 100.0)


@dataclass(frozen=True)
class Remainder(_Unlisted):
    """A smooth surface without a cause, as a fit of residuals leaves it: radial basis functions."""

    torque: float = size("N m", 3.0, -20.0, 20.0, "of a basis function")

    def engine_drag(self, state):
        rng = np.random.default_rng(3)
        drag = np.zeros(np.shape(state.engine_speed))
        for _ in range(25):
            speed = rng.uniform(TABLE_SPEED.low, TABLE_SPEED.high)
            power = rng.uniform(0.0, 80e3)
            stroke = rng.uniform(-1.0, 1.0)
            distance = ((state.engine_speed - speed) / 50.0) ** 2
            distance = distance + ((state.load_power - power) / 25e3) ** 2
            distance = distance + ((state.displacement_ratio - stroke) / 0.4) ** 2
            drag = drag + rng.normal() * np.exp(-0.5 * distance)
        return self.torque * drag


CASES = {
    "charge pump, clutch drag, port pressure drop": ("tractor", THREE_EFFECTS),
    "the same without clutches, pump on the row": (
        "output_coupled",
        (ChargePump(torque=4.0), PortPressureDrop(drop=3e5)),
    ),
    "effect of a user": ("hm4", (Seal(torque=5.0),)),
    "empirical remainder": ("hm4", (Remainder(torque=5.0),)),
}
"""Name of a shipped parameter file, and effects."""


def affected_model(case):
    """Return a shipped model with the effects of a case."""
    name, effects = CASES[case]
    model = hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))
    return replace(model, effects=effects)


def points_of_tables(seed, count):
    """Return random strokes, engine speeds and loads where tables reach."""
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(-1.0, 1.0, count),
        rng.uniform(TABLE_SPEED.low, TABLE_SPEED.high, count),
        rng.uniform(TABLE_LOAD.low, TABLE_LOAD.high, count),
    )

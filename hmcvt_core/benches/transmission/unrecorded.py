# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Quantities of a transmission and its bench that may vary although nothing records them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...diagnosis.system import Array, Points, System, Unrecorded
from ...physics.effects.base import Effect
from ...physics.effects.hydraulic import REFERENCE_TEMPERATURE, CompressibilityAir
from ...physics.effects.mechanical import ChargePump
from ...physics.effects.sensor import EngineTorqueZero, OutputTorqueZero
from ...physics.effects.wear import UnreadOilTemperature
from .channels import OIL_TEMPERATURE

_QUANTITIES: tuple[tuple[str, str, type[Effect]], ...] = (
    ("oil temperature", "the oil temperature", UnreadOilTemperature),
    ("charge pressure", "the charge pressure", ChargePump),
    ("air in the oil", "the loop pressure and foam in the tank", CompressibilityAir),
    ("zero of the engine torque meter", "the meter's temperature", EngineTorqueZero),
    ("zero of the output torque meter", "the meter's temperature", OutputTorqueZero),
)
"""Name, what to record, and the effect whose typical size stands for a change."""


def unrecorded(system: System, base: Array, points: Points) -> Sequence[Unrecorded]:
    """Return quantities that may vary, with what a change of each does to the readings.

    Those that a column records are left out by the diagnosis (`statements/scatter.py`).

    Args:
        system: the transmission.
        base: scaled base parameters, shape (p,).
        points: operating points.
    """
    quantities = []
    for name, sensor, kind in _QUANTITIES:
        at_points = points
        if kind is UnreadOilTemperature:
            # The viscosity acts only where there is a temperature; which one does not matter.
            some_row = next(iter(points.values()))
            nominal = np.full(len(some_row), REFERENCE_TEMPERATURE)
            at_points = {**points, OIL_TEMPERATURE.name: nominal}
        effect = kind()
        size = effect.sizes()[0]
        changed = effect.with_values({size.name: size.typical})
        reference = system.predict(base, (), at_points)
        change = system.predict(base, (changed,), at_points) - reference
        quantities.append(Unrecorded(name, sensor, change))
    return quantities

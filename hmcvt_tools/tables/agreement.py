# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Units of a table of one pump or motor that states none, by quantities that must agree.

Flow, displacement, speed and volumetric efficiency give one equation; torque, displacement,
pressure and mechanical efficiency another one. Only some units fulfil both.
"""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from hmcvt_core.transmission.ranges import Array

from .units import to_si

_CANDIDATES: Mapping[str, tuple[str, ...]] = {
    "speed": ("rpm", "rad/s"),
    "pressure": ("bar", "MPa", "kPa", "Pa", "psi"),
    "displacement": ("cm3", "in3", "m3/rad"),
    "flow": ("L/min", "gpm", "m3/s"),
    "torque": ("N m", "lb ft", "lb in"),
    "part": ("-", "%"),
}
"""Usual units by what they measure. No two sets of them agree within 5 % by chance."""
NEEDED: Mapping[str, str] = {
    "speed": "speed",
    "pressure": "pressure",
    "displacement": "displacement",
    "flow": "flow",
    "torque": "torque",
    "volumetric_efficiency": "part",
    "mechanical_efficiency": "part",
}
"""Columns of both equations, and what each measures."""


def agreeing_units(
    readings: Mapping[str, Array], sign: float, tolerance: float
) -> list[dict[str, str]]:
    """Return the sets of units, by what they measure, in which both equations hold.

    Args:
        readings: numbers of the columns of `NEEDED`, shape (n,) each.
        sign: 1 for a pump, -1 for a motor, whose power goes the other way.
        tolerance: part by which both sides of an equation may differ in the median.
    """
    found = []
    for units in _sets_of_units():
        values = {}
        for name, kind in NEEDED.items():
            size, zero = to_si(kind, units[kind])
            values[name] = size * (readings[name] - zero)
        if agree(values, sign, tolerance):
            found.append(units)
    return found


def _sets_of_units() -> Iterator[dict[str, str]]:
    """Yield every set of one unit for each kind."""
    for chosen in product(*_CANDIDATES.values()):
        yield dict(zip(_CANDIDATES, chosen, strict=True))


def agree(values: Mapping[str, Array], sign: float, tolerance: float) -> bool:
    """Return whether flow and torque follow from the other values.

    Args:
        values: in SI, by the names of `NEEDED`.
        sign: 1 for a pump, -1 for a motor.
        tolerance: part by which the median of both sides may differ.
    """
    volumetric = values["volumetric_efficiency"]
    mechanical = values["mechanical_efficiency"]
    usable = (volumetric > 0.0) & (mechanical > 0.0) & (values["torque"] > 0.0)
    usable &= (values["flow"] > 0.0) & (values["pressure"] > 0.0)
    if not usable.any():
        return False
    of = {name: column[usable] for name, column in values.items()}
    flow = of["displacement"] * of["speed"] * of["volumetric_efficiency"] ** sign
    torque = of["displacement"] * of["pressure"] * of["mechanical_efficiency"] ** -sign
    for measured, computed in ((of["flow"], flow), (of["torque"], torque)):
        if abs(np.log(np.median(measured / computed))) > tolerance:
            return False
    return True

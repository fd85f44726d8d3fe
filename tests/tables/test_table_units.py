# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The usual units of tables have the sizes that pint knows."""

import re

import pint
import pytest

from hmcvt_core.transmission.units import KIND_UNITS, UNITS, kind_of
from hmcvt_tools.tables.units import to_si

REGISTRY = pint.UnitRegistry()
BASES = {
    "part": "dimensionless",
    "speed": "rad/s",
    "torque": "N*m",
    "power": "W",
    "temperature": "degC",
    "time": "s",
    "pressure": "Pa",
    "flow": "m**3/s",
    "displacement": "m**3/rad",
    "velocity": "m/s",
    "force": "N",
    "mass_flow": "kg/s",
    "specific_fuel": "kg/J",
}
WRITTEN = {
    "-": "dimensionless",
    "%": "percent",
    "r/min": "turn/min",
    "Nm": "N*m",
    "N m": "N*m",
    "kNm": "kN*m",
    "lb ft": "foot*force_pound",
    "lb in": "inch*force_pound",
    "daN m": "10*N*m",
    "N cm": "N*cm",
    "kgf m": "kgf*m",
    "PS": "metric_horsepower",
    "deg C": "degC",
    "C": "degC",
    "\N{DEGREE SIGN}C": "degC",
    "deg F": "degF",
    "gpm": "gallon/min",
    "m3/s": "m**3/s",
    "m3/h": "m**3/h",
    "cm3/s": "cm**3/s",
    "m3/rad": "m**3/rad",
    "m3/r": "m**3/turn",
    "cm3": "cm**3/turn",
    "in3": "inch**3/turn",
    "lb/h": "pound/hour",
    "g/h": "gram/hour",
    "kg/h": "kilogram/hour",
    "g/kWh": "gram/(kilowatt*hour)",
    "kg/kWh": "kilogram/(kilowatt*hour)",
}
"""Units that pint writes in another way, or that stand for a rate of turns."""
UNKNOWN_TO_PINT = {"1/min", "min-1", "U/min"}
"""Turns a minute; pint reads them as a frequency in radians."""


def pairs():
    listed = {(kind, unit) for kind, units in KIND_UNITS.items() for unit in units}
    listed |= {(kind_of(name), unit) for name, units in UNITS.items() for unit in units}
    known = {pair for pair in listed if pair[1] not in UNKNOWN_TO_PINT}
    return sorted(pair for pair in known if "@" not in pair[1])


@pytest.mark.parametrize(("kind", "unit"), pairs())
def test_usual_units_are_those_of_pint(kind, unit):
    written = re.sub(r"^L/", "liter/", WRITTEN.get(unit, unit))
    size, zero = to_si(kind, unit)
    margin = 1e-9 * (kind == "temperature")  # 32 deg F is 0 deg C
    for reading in (0.0, 1.0, 37.5):
        if kind == "temperature":
            known = REGISTRY.Quantity(reading, written)
        else:
            known = reading * REGISTRY(written)
        expected = known.to(BASES[kind]).magnitude
        assert size * (reading - zero) == pytest.approx(expected, rel=1e-6, abs=margin)

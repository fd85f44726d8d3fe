# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Usual units: how people write them, what they measure, and their size in SI.

This is the one list of units; `hmcvt_tools.tables.units` looks other ones up with Pint.
"""

import re
import unicodedata
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from .quantities import BY_NAME, QUANTITIES
from .ranges import RPM

_SPEED = {
    "rad/s": 1.0,
    "rpm": RPM,
    "r/min": RPM,
    "1/min": RPM,
    "min-1": RPM,
    "U/min": RPM,
}
_TORQUE = {"N m": 1.0, "Nm": 1.0, "kNm": 1e3, "lb ft": 1.3558179483314004}
_POWER = {"W": 1.0, "kW": 1e3, "hp": 745.6998715822702, "PS": 735.49875}
_PART = {"-": 1.0, "%": 0.01, "\u2030": 1e-3, "ppm": 1e-6}
_STROKE = {**_PART, "%@50": 0.02, "-@0.5": 2.0}
"""Units of the stroke; behind `@` stands the reading of the neutral."""
_FLOW = {
    "m3/s": 1.0,
    "L/min": 1.0 / 6e4,
    "gpm": 6.30901964e-5,
    "cm3/s": 1e-6,
    "m3/h": 1.0 / 3600.0,
}
_TURN = 2.0 * np.pi
_POUND = 0.45359237
_USUAL: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "stroke": _STROKE,
        "speed": _SPEED,
        "torque": _TORQUE,
        "power": _POWER,
        "efficiency": _PART,
        "temperature": {
            "deg C": 1.0,
            "degC": 1.0,
            "C": 1.0,
            "\N{DEGREE SIGN}C": 1.0,
            "deg F": 5.0 / 9.0,
            "K": 1.0,
        },
        "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
        "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757},
        "flow": _FLOW,
    }
)
"""Usual units of the kinds of quantities, each with its size in the first one."""
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {quantity.name: _USUAL[quantity.kind] for quantity in QUANTITIES}
)
"""Size of the units of every quantity in the one that hmcvt keeps it in, which is the first."""

KIND_UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "part": _STROKE,
        "speed": {**_SPEED, "deg/s": np.pi / 180.0},
        "torque": {
            **_TORQUE,
            "daN m": 10.0,
            "N cm": 0.01,
            "kgf m": 9.80665,
            "lb in": 0.1129848290276167,
        },
        "power": _POWER,
        "temperature": _USUAL["temperature"],
        "time": _USUAL["time"],
        "pressure": _USUAL["pressure"],
        "flow": _FLOW,
        "velocity": {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "ft/s": 0.3048},
        "force": {"N": 1.0, "kN": 1e3, "daN": 10.0, "lbf": 4.4482216152605},
        "displacement": {
            "m3/rad": 1.0,
            "m3/r": 1.0 / _TURN,
            "cm3": 1e-6 / _TURN,
            "in3": 1.6387064e-5 / _TURN,
        },
        "mass_flow": {
            "kg/s": 1.0,
            "g/s": 1e-3,
            "mg/s": 1e-6,
            "kg/h": 1.0 / 3600.0,
            "g/h": 1e-3 / 3600.0,
            "lb/h": _POUND / 3600.0,
        },
        "specific_fuel": {"g/kWh": 1e-3 / 3.6e6, "kg/kWh": 1.0 / 3.6e6},
    }
)
"""The same by what the units measure; flow and displacement are of hydrostatic units, velocity and
force of vehicles, mass flow and specific fuel of engines."""

ZERO: Mapping[str, float] = MappingProxyType(
    {"deg F": 32.0, "K": 273.15, "%@50": 50.0, "-@0.5": 0.5}
)
"""Reading at 0 deg C or in neutral, of the units that have another zero."""

_ALSO = {
    "rad/s": "rad/sec 1rad/s rads-1 s-1rad radps radpers rad_s rad_per_s rad_per_sec",
    "N m": "n_m",
    "lb ft": "lbfft lbft ftlb ftlbf ftlbs lbsft footpound footpounds poundfeet lbf*ft",
    "kNm": "kN*m kn_m",
    "kgf m": "kpm mkp mkg kgm",
    "lb in": "lbfin inlb inlbf inlbs lbin",
    "deg/s": "grad/s deg/sec deg_s deg_per_s deg_per_sec",
    "hp": "bhp horsepower",
    "PS": "cv ch",
    "rpm": "rev_min rev_per_min "
    "/min t/min tr/min rev/min rev/minute giri/min upm umin-1 r.p.m. rpms "
    "revs/min vueltas/min r.min-1 \u8f6c/\u5206 ob/min \u043e\u0431/\u043c\u0438\u043d",
    "kW": "\u5343\u74e6",
    "bar": "bara barg bard",
    "psi": "psia psid psig lbf/in2",
    "deg C": "deg_c celsius degcelsius gradc \u2103",
    "K": "kelvin",
    "deg F": "deg_f f fahrenheit \u2109",
    "ms": "msec milliseconds millisecond",
    "s": "sec secs second seconds sek sekunden \u79d2",
    "min": "minute minutes minuten mins \u5206\u949f",
    "h": "hour hours hr hrs std.",
    "-": "1 pu p.u. fraction",
    "%": "percent pct prozent pourcent porciento \uff05",
    "\u2030": "permille per_mille promille perthousand o/oo",
    "km/h": "kph kmh kmph km/hr",
    "mph": "mi/h mile/h miles/h",
    "m/s": "mps m/sec ms-1",
    "ft/s": "fps",
    "L/min": "lpm l/min liter/min litre/min",
    "gpm": "gal/min usgpm gallon/min us.gal/min",
    "m3/s": "m^3/s cbm/s",
    "cm3/s": "ml/s cc/s",
    "cm3": "cc cm3/r cc/r cm3/rev cc/rev ml/r ml/rev cm3/u ccm ccm/u cm^3 cm^3/rev cm3/tr",
    "in3": "in3/rev in3/r cuin cuin/rev cir in^3 in^3/rev ci",
    "m3/rad": "m^3/rad",
    "m3/r": "m3/rev m^3/rev m^3/r",
    "kg/h": "kg/hr",
    "g/h": "g/hr",
    "lb/h": "lb/hr lbs/hr pph",
    "g/kWh": "g/kw-hr g/kwhr g/kw/h g/(kw*h)",
}
_AMBIGUOUS = ("1/s", "s-1", "hz", "rps", "rev/s", "r/s", "u/s")
"""Units of speed of which some say radians and some turns, to be asked."""
_OTHER = (
    *("deg", "rad", "rev", "turns", "V", "mV", "mA", "Ohm", "mm", "kg", "L/h"),
    *("kJ", "kWh"),
)
"""Usual units of what is no quantity of a bench."""
_LETTERS = str.maketrans(
    {
        "\u03b7": " eta ",
        "\u03b5": " eps ",
        "\u03c9": " omega ",
        "\u03b1": " alpha ",
        "\u0394": " delta ",
        "\u00b1": " std ",
        "\u2206": " delta ",
        "\u00df": "ss",
        "\u00e4": "ae",
        "\u00f6": "oe",
        "\u00fc": "ue",
        "\u00c4": "Ae",
        "\u00d6": "Oe",
        "\u00dc": "Ue",
        "\u00b0": "deg",
        "\u00ba": "deg",
        "\u207b": "-",
        "\u2212": "-",
        "\u00b9": "1",
        "\u00b3": "3",
        "\u00b7": " ",
        "\u22c5": " ",
        "\u2219": " ",
        "\u2022": " ",
    }
)


class Unit(NamedTuple):
    """A unit as it was understood.

    Attributes:
        kind: what it measures, a key of `KIND_UNITS`; `other` for anything else.
        name: as hmcvt writes it; of a known kind but not in it: ambiguous.
    """

    kind: str
    name: str


def plain_text(text: str) -> str:
    """Return a text without accents; letters of other scripts stay."""
    translated = unicodedata.normalize("NFC", text).translate(_LETTERS)
    decomposed = unicodedata.normalize("NFKD", translated)
    return "".join(letter for letter in decomposed if not unicodedata.combining(letter))


def _key(unit: str) -> str:
    return re.sub(
        r"[ *.^()\[\]{}<>]|(?<=[a-z])-(?=[a-z])", "", plain_text(unit).lower()
    )


def _known_units() -> dict[str, Unit]:
    known: dict[str, Unit] = {}
    for kind, units in KIND_UNITS.items():
        for unit in units:
            for text in (unit, *_ALSO.get(unit, "").split()):
                known.setdefault(_key(text), Unit(kind, unit))
    for text in _AMBIGUOUS:
        known[_key(text)] = Unit("speed", "1/s")
    for text in _OTHER:
        known.setdefault(_key(text), Unit("other", text))
    return known


_WRITTEN = _known_units()


@lru_cache(maxsize=1024)
def usual_unit(text: str) -> Unit | None:
    """Return the unit that a text names among the usual ones; None for others."""
    return _WRITTEN.get(_key(text))


def kind_of(quantity: str) -> str:
    """Return what a quantity measures, a key of `KIND_UNITS`."""
    if quantity in BY_NAME:
        kind = BY_NAME[quantity].kind
        return "part" if kind in ("stroke", "efficiency") else kind
    return quantity.rpartition("_")[2]

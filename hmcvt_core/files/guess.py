# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Quantities of a bench, their units, and how people write both."""

import re
import unicodedata
from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from ..transmission.ranges import RPM, Array

_SPEED = {
    "rad/s": 1.0,
    "rpm": RPM,
    "r/min": RPM,
    "1/min": RPM,
    "min-1": RPM,
    "U/min": RPM,
}
_TORQUE = {"N m": 1.0, "Nm": 1.0, "kNm": 1e3, "lb ft": 1.3558179}
_POWER = {"W": 1.0, "kW": 1e3, "hp": 745.69987, "PS": 735.49875}
_PART = {"-": 1.0, "%": 0.01}
UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "displacement_ratio": _PART,
        "engine_speed": _SPEED,
        "output_speed": _SPEED,
        "engine_torque": _TORQUE,
        "output_torque": _TORQUE,
        "load_torque": _TORQUE,
        "engine_power": _POWER,
        "output_power": _POWER,
        "efficiency": _PART,
        "efficiency_std": _PART,
        "oil_temperature": {
            "deg C": 1.0,
            "degC": 1.0,
            "C": 1.0,
            "\N{DEGREE SIGN}C": 1.0,
            "deg F": 5.0 / 9.0,
            "K": 1.0,
        },
        "stamp": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
        "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": 6894.757},
    }
)
"""Size of the units of every quantity in the one that hmcvt keeps it in, which is the first."""

# Other ways to write a unit, without blanks, brackets and marks.
_ALSO = {
    "rad/s": "rad/sec",
    "lb ft": "lbfft ftlb ftlbf",
    "hp": "bhp",
    "PS": "cv",
    "rpm": "/min t/min tr/min rev/min rev/minute giri/min upm umin-1",
    "bar": "bara barg bard",
    "psi": "psia psid",
    "deg C": "celsius",
    "K": "kelvin",
    "deg F": "f fahrenheit",
    "ms": "msec",
    "s": "sec second seconds",
    "min": "minute minutes",
    "h": "hour hours",
    "-": "1 pu",
    "%": "percent pct prozent",
}
_KINDS = {"ratio": "part", "efficiency": "part", "std": "part", "stamp": "time"}
# Up to which size of the larger values a unit that nobody tells is likely.
_LIKELY: Mapping[str, Mapping[str, float]] = {
    "part": {"-": 1.5, "%": np.inf},
    "speed": {"rad/s": 320.0, "rpm": np.inf},
    "torque": {"kNm": 5.0, "N m": np.inf},
    "power": {"kW": 1000.0, "W": np.inf},
    "temperature": {"deg C": 150.0, "deg F": 260.0, "K": np.inf},
    "time": {"s": np.inf},
}
_LETTERS = str.maketrans(
    {
        "\u03b7": " eta ",
        "\u03b5": " eps ",
        "\u03c9": " omega ",
        "\u03b1": " alpha ",
        "\u0394": " d ",
        "\u2206": " d ",
        "\u00df": "ss",
        "\u00e4": "ae",
        "\u00f6": "oe",
        "\u00fc": "ue",
        "\u00c4": "Ae",
        "\u00d6": "Oe",
        "\u00dc": "Ue",
        "\u00b0": "deg",
        "\u207b": "-",
        "\u2212": "-",
        "\u00b9": "1",
        "\u00b7": " ",
        "\u22c5": " ",
    }
)
# Words of the field; of four letters and more they may stand within a word (Abtriebsdrehzahl).
_WORDS: Mapping[str, str] = {
    "std": "std sigma uncertainty stdev scatter streuung",
    "efficiency": "efficiency eta wirkungsgrad eff rendement effic rendimento",
    "stroke": "displacement stroke eps epsilon swash swivel schwenk pumpenhub hub verstell "
    "aussteuer alpha displ cilindrata cylindree",
    "temperature": r"temp \bt.oil \bt.oel temperature temperatur oiltemp oeltemp",
    "pressure": "pressure druck dp pressione pression",
    "power": "power leistung pwr puissance potenza",
    "torque": "torque drehmoment moment trq tq md couple coppia m t",
    "speed": "speed drehzahl omega rpm n regime vitesse velocity rev w velocita",
    "time": "time zeit stamp timestamp date uhrzeit",
    "engine": "engine eng input in antrieb eingang verbrennungsmotor motordreh motormoment "
    "motorleistung diesel ice ein an e 1 moteur entree ingresso mot vm dm",
    "output": "output out abtrieb ausgang sortie uscita axle wheel aus ab o a 2 cardan",
    "load": "load last",
    "feed": "feed charge boost speise lade",  # as of the engine's oil: not over the motor
    "oil": r"\boil oel\w* sump tank reservoir lube huile olio hydrau getriebe gear transmission "
    "atf utto fluid hyd hst drain",
    "loss": "loss losses verlust fuel ambient room target set soll so cmd demand limit coolant "
    "wasser",
    "stage": "stage gang fahrbereich stufe",
}
_FIND = {
    meaning: re.compile(
        "|".join(word if len(word) > 3 else rf"\b{word}\b" for word in words.split())
    )
    for meaning, words in _WORDS.items()
}
_ANY = re.compile(
    "|".join(
        sorted(  # the longest first: temperature before temp
            "|".join(find.pattern for find in _FIND.values()).split("|"),
            key=len,
            reverse=True,
        )
    )
)
_NUMERIC = re.compile(r"[+-]?([.,]?\d|nan|inf)", re.IGNORECASE)
_BRACKETS = re.compile(
    r"[\[(<{]([^\])>}]*)[\])>}]\s*$|(?:\s+in|[,:;|]|\s/)\s+(\S.*)$|_([a-z%]+)$"
)


def _plain(text: str) -> str:
    """A text without accents."""
    plain = unicodedata.normalize("NFC", text).translate(_LETTERS)
    return unicodedata.normalize("NFKD", plain).encode("ascii", "ignore").decode()


def _key(unit: str) -> str:
    return re.sub(r"[ *.^()\[\]{}<>]|(?<=[a-z])-(?=[a-z])", "", _plain(unit).lower())


def _kind(quantity: str) -> str:
    last = quantity.rpartition("_")[2]
    return _KINDS.get(last, last)


_WRITTEN = {
    _key(text): (_kind(quantity), unit)
    for quantity, units in UNITS.items()
    for unit in units
    for text in (unit, *_ALSO.get(unit, "").split())
}
# Radians or revolutions: nobody knows, so it is none of `UNITS`.
_WRITTEN |= dict.fromkeys(("1/s", "s-1", "hz"), ("speed", "1/s"))


@lru_cache(maxsize=1024)  # of the cells of a long table
def unit_of(text: str) -> tuple[str, str] | None:
    """What a text that names a unit measures, and the unit; None where it names none."""
    return _WRITTEN.get(_key(text))


def holds_units(cells: Sequence[str]) -> bool:
    """Whether a row holds words alone, units among them."""
    others = [cell for cell in cells if unit_of(cell) is None]
    return len(others) < len(cells) and not any(map(_NUMERIC.match, others))


def _meanings(name: str) -> tuple[str, set[str]]:
    """A name in words of its own, and what they mean."""
    apart = (
        re.sub(r"(?<=[a-z])(?=[A-Z\d])", " ", _plain(name)).lower().replace("_", " ")
    )
    return apart, {meaning for meaning, find in _FIND.items() if find.search(apart)}


def _bare(
    name: str, unit: str = ""
) -> tuple[str, tuple[str, str] | None, re.Match[str] | None]:
    """A name without the unit behind it, what that or another unit tells, and where it stands."""
    hit = _BRACKETS.search(name)
    told = unit_of(unit) or (
        unit_of(next(filter(None, hit.groups()), "")) if hit else None
    )
    return name[: hit.start()] if hit and told else name, told, hit


def quantity_of(name: str, unit: str = "") -> tuple[str, str] | None:
    """Quantity that a column is of, by its name and unit, and the unit; `""` if not told."""
    bare, told, hit = _bare(name, unit)
    apart, means = _meanings(bare)
    if (
        hit
        and told
        and not unit_of(unit)
        and re.fullmatch("[a-z]{1,2}", hit[3] or "")
        and (told[0] not in means and apart != "t")
    ):
        told, (apart, means) = None, _meanings(name)  # an index, as of eta_h
    if "loss" in means or not apart.strip(" .-"):
        return None
    kind, unit = told or ("", "")
    if kind in ("", "part"):
        kind = next((each for each in _TOLD if each in means), "")
        if "ratio" in apart and kind != "stroke":
            return None
    if kind == "efficiency":
        return "efficiency_std" if "std" in means else kind, unit
    if (
        not kind
        or "std" in means
        or (kind == "pressure" and means & {"feed", "engine"})
        or (
            kind == "temperature"
            and "oil" not in means
            and re.search("[a-z] +[a-z]", apart)
        )
    ):
        return None
    if kind in _ALONE:
        return _ALONE[kind], unit
    if "load" in means and "output" not in means:
        return ("load_torque" if kind == "torque" else f"output_{kind}"), unit
    # What the engine puts out goes into the transmission.
    sides = ("engine", "output") if "of the engine" in apart else ("output", "engine")
    return f"{next(filter(means.__contains__, sides), 'any')}_{kind}", unit


def strange_words(name: str) -> int:
    """How many words of a column's name are none of the field."""
    return len(_ANY.sub(" ", _meanings(_bare(name)[0])[0]).split())


_TOLD = (
    "efficiency",
    "stroke",
    "temperature",
    "pressure",
    "power",
    "torque",
    "speed",
    "time",
    "stage",
)
_ALONE = {
    "stroke": "displacement_ratio",
    "temperature": "oil_temperature",
    "pressure": "pressure",
    "time": "stamp",
    "stage": "stage",
}


def likely_unit(quantity: str, values: Array) -> str:
    """The unit of values (n,), NaN among them, that nobody tells: by the size of the larger."""
    size = np.nanquantile(np.abs(values), 0.9)
    return next(unit for unit, most in _LIKELY[_kind(quantity)].items() if size <= most)

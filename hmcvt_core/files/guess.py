# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which column of a table is what, and in which unit: from names, unit rows and ranges."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GREEK = str.maketrans({"\u03b7": " eta ", "\u03b5": " eps ", "\u03c9": " omega ",
                        "\u03b1": " alpha ", "\u0394": " d ", "\u2206": " d ",
                        "\u00df": "ss", "\u00b0": "deg",
                        "\u207b": "-", "\u2212": "-", "\u00b9": "1", "\u00b7": " ", "\u22c5": " "})
# What is measured, by the unit; each unit as it is written, and by its name in `UNITS`.
_UNITS: Mapping[str, Mapping[str, str]] = {
    "speed": {"rad/s": r"rad ?/ ?s(ec)?|s-1|1/s", "rpm": r"rpm|(r|u|1|tr|rev|giri)? ?/ ?min\.?|"
              r"(u )?min(\^?-1|\^\(-1\))|rev/minute|upm|t/min"},
    "torque": {"kNm": "kn[ *.]?m", "N m": "n[ *.]?m", "lb ft": r"(lbf?|ft)[ -]?(ft|lbf?)\.?"},
    "power": {"kW": "kw", "W": "w", "hp": "hp|bhp", "PS": "ps|cv"},
    "pressure": {"bar": r"bar(\(?[agd]\)?)?", "MPa": "mpa", "kPa": "kpa", "Pa": "pa",
                 "psi": "psi[ad]?"},
    "temperature": {"deg C": "(deg ?)?c|celsius", "deg F": "(deg ?)?f|fahrenheit", "K": "k|kelvin"},
    "time": {"ms": "ms|msec", "s": "s|sec|seconds?", "min": "min|minutes?", "h": "h|hours?"},
    "part": {"%": "%|percent|pct|prozent", "-": r"-|1|\(-\)|p\.?u\.?"},
}
# Words of the field; of four letters and more they may stand within a word (Abtriebsdrehzahl).
_WORDS: Mapping[str, str] = {
    "std": "std sigma uncertainty stdev scatter streuung",
    "efficiency": "efficiency eta wirkungsgrad eff rendement effic rendimento",
    "stroke": "displacement stroke eps epsilon swash swivel schwenk pumpenhub hub verstell "
              "aussteuer alpha displ cilindrata cylindree",
    "temperature": "temp temperature temperatur oiltemp oeltemp",
    "pressure": "pressure druck dp pressione pression",
    "power": "power leistung pwr puissance potenza",
    "torque": "torque drehmoment moment trq tq md couple coppia m t",
    "speed": "speed drehzahl omega rpm n regime vitesse velocity rev w velocita",
    "time": "time zeit stamp timestamp date uhrzeit",
    "engine": "engine eng input in antrieb eingang verbrennungsmotor motordreh motormoment "
              "motorleistung diesel ice ein an e 1 moteur entree ingresso mot vm dm",
    "output": "output out abtrieb ausgang sortie uscita axle wheel aus ab o a 2 cardan",
    "load": "load last",
    "loss": "loss losses verlust fuel ambient room target set soll cmd demand limit coolant wasser",
    "stage": "stage gang fahrbereich stufe",
}
_FIND = {meaning: re.compile("|".join(
    word if len(word) > 3 else rf"\b{word}\b" for word in words.split()))
    for meaning, words in _WORDS.items()}
_BRACKETS = re.compile(r"[\[(<{]([^\])>}]*)[\])>}]\s*$|(?:\s+in|[,:;|]|\s/)\s+(\S.*)$|_([a-z%]+)$")


class Guess(NamedTuple):
    """A column and its unit for a quantity, and where the unit comes from."""

    column: str
    unit: str
    why: str


def _plain(name: str) -> str:
    """Lower case, without accents."""
    text = name.translate(_GREEK).lower()
    for letter in "aou":
        text = text.replace(unicodedata.normalize("NFC", f"{letter}\u0308"), f"{letter}e")
    return unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()


def _words(name: str) -> str:
    """The words of a name, apart."""
    apart = _plain(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)).replace("_", " ")
    return re.sub(r"(?<=[a-z])(?=\d)", " ", apart)


def unit_of(text: str) -> tuple[str, str] | None:
    """What a text that names a unit measures, and the unit; None where it names none."""
    known = " ".join(_plain(text).strip(" []()<>{}.").split())
    for kind, units in _UNITS.items():
        for unit, written in units.items():
            if re.fullmatch(written, known):
                return kind, unit
    return None


def quantity_of(name: str, unit: str = "") -> tuple[str, str] | None:
    """Quantity that a column is of, by its name and unit, and the unit; `""` if not told."""
    hit = _BRACKETS.search(name)
    inside = next((part for part in hit.groups() if part), "") if hit else ""
    told = (unit_of(unit) if unit.strip() else None) or (unit_of(inside) if inside else None)
    words = _words(name[:hit.start()] if hit and told else name)
    means = {meaning for meaning, find in _FIND.items() if find.search(words)}
    kind = told[0] if told and told[0] != "part" else None
    if "loss" in means or not words.strip(" .-"):
        return None
    unit = told[1] if told else ""
    if kind is None or kind == "part":
        kind = next((each for each in ("efficiency", "stroke", "temperature", "pressure", "power",
                                       "torque", "speed", "time", "stage") if each in means), None)
        if "ratio" in words and kind != "stroke":
            return None
    if kind is None:
        return None
    if kind == "efficiency" or kind == "part":
        return "efficiency_std" if "std" in means else "efficiency", unit
    if "std" in means:
        return None
    if kind in _ALONE:
        return _ALONE[kind], unit
    if "load" in means and "output" not in means:
        return ("load_torque" if kind == "torque" else f"output_{kind}"), unit
    side = "output" if "output" in means else "engine" if "engine" in means else "any"
    return f"{side}_{kind}", unit


_ALONE = {"stroke": "displacement_ratio", "temperature": "oil_temperature", "pressure": "pressure",
          "time": "stamp", "stage": "stage"}


def guess_columns(
    names: Mapping[str, str], numbers: Mapping[str, Array], taken: Mapping[str, str]
) -> dict[str, Guess]:
    """Guess which columns hold which quantities.

    Args:
        names: unit that a row below the header gives, by column; empty where it gives none.
        numbers: of each column, NaN where a cell is none.
        taken: column of each quantity that is known already.
    """
    found: dict[str, Guess] = {}
    for name, below in names.items():
        hit = quantity_of(name, below)
        if hit is None or name in taken.values() or (
                hit[0] != "stage" and not np.isfinite(numbers[name]).any()):
            continue
        quantity, unit = hit
        why = ("row of units" if below.strip() else "name") if unit else ""
        if quantity not in found and quantity not in taken:
            found[quantity] = Guess(name, unit, why)
    known = {**found, **taken}
    for kind, other in (("speed", "engine_speed"), ("torque", "load_torque"),
                        ("power", "output_power")):
        if (alone := found.pop(f"any_{kind}", None)) and other not in known:
            found[other] = alone
    _without_doubles(found, taken)
    for quantity, guess in found.items():
        if not guess.unit:
            found[quantity] = guess._replace(
                unit=_by_range(quantity, numbers[guess.column]), why="range")
    # An output that turns slowly may look like rad/s; a bench has one unit for both shafts.
    if (engine := found.get("engine_speed")) and "output_speed" in found and (
            found["output_speed"].why == "range"):
        found["output_speed"] = found["output_speed"]._replace(unit=engine.unit)
    return found


def _without_doubles(found: dict[str, Guess], taken: Mapping[str, str]) -> None:
    """Drop what says the same as something better."""
    known = {*found, *taken}
    for better, worse in (
            ({"efficiency"}, "engine_power"), ({"efficiency"}, "engine_torque"),
            ({"engine_torque"}, "engine_power"), ({"output_torque", "output_speed"}, "load_torque"),
            ({"output_torque", "output_speed"}, "output_power"),
            ({"load_torque"}, "output_power"), ({"load_torque"}, "output_torque"),
            ({"output_power"}, "output_torque")):
        if better <= known and worse in found:
            del found[worse]
            known.discard(worse)


def _by_range(quantity: str, values: Array) -> str:
    """Unit in which the values are plausible; the first of `UNITS` where all are."""
    size = float(np.nanquantile(np.abs(values), 0.9)) if np.isfinite(values).any() else 0.0
    kind = quantity.rpartition("_")[2]
    if quantity in ("displacement_ratio", "efficiency", "efficiency_std"):
        return "%" if size > 1.5 else "-"
    if kind == "speed":
        return "rpm" if size > 320.0 else "rad/s"
    if kind == "torque":
        return "kNm" if size < 5.0 else "N m"
    if kind == "power":
        return "W" if size > 1000.0 else "kW"
    if kind == "temperature":
        return "deg C" if size <= 150.0 else "deg F" if size < 260.0 else "K"
    if kind == "pressure":
        return "Pa" if size > 1e4 else "bar" if size > 60.0 else "MPa"
    return "s" if quantity == "stamp" else ""

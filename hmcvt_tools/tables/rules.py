# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which words, units and sides of the transmission name which quantity.

`transmission.words` gives the meaning of each word, in several languages; the registry of
quantities (`transmission.quantities`) which meanings make a quantity. Every word of a name counts:
a word that is not listed is reported, so that the proposal can ask instead of passing over it.
"""

import re
from collections.abc import Mapping, Set
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

from hmcvt_core.transmission.quantities import QUANTITIES, Heading
from hmcvt_core.transmission.units import KIND_UNITS, Unit, usual_unit
from hmcvt_core.transmission.words import (
    COMPOUND_PARTS,
    MEANINGS,
    meanings_of,
    words_of,
)

from .units import to_si, unit_of

KINDS = (
    "efficiency",
    "stroke",
    "temperature",
    "pressure",
    "power",
    "torque",
    "speed",
    "flow",
    "time",
    "stage",
)
SHAFT_KINDS = ("speed", "torque", "power")
"""What is measured at a shaft, so that its side must be known."""

_OF_A_PART = frozenset(
    {
        *("gear", "gears", "zahnrad", "verzahnung", "planetary", "planet", "mesh"),
        *("differential", "clutch", "kupplung", "variator", "hst", "hydrostat"),
        *("brake", "belt", "drive", "axle", "stage", "stufe"),
        *("v", "hm", "mh", "diferencial", "differenziale", "differentielle"),
    }
)
"""Next to an efficiency these words name a part of the transmission, or more than it."""
_DIFFERENCE = frozenset(
    {
        *("delta", "diff", "difference", "differential"),
        *("diferencial", "differenziale", "differentielle"),
    }
)
"""Next to what is measured at a shaft these words name a change of it."""
_GERMANIC_KINDS = frozenset(
    {
        *("drehzahl", "drehmoment", "moment", "leistung"),
        *("par", "velocidad", "regimen", "potencia"),
    }
)
"""Next to these words `motor` is German or Spanish and means the engine."""

_OIL_PLACES = frozenset(
    {
        *("getriebe", "transmission", "gearbox", "hydraulic", "hyd", "hydr"),
        *("boite", "cambio", "caja", "transmision", "trasmissione", "hydraulik"),
        *("hydraulique", "hidraulico", "hidraulica", "idraulico", "idraulica"),
    }
)

_PORTS = frozenset({"a", "b", "port"})
"""Next to a pressure these words name one port of the hydrostatic units."""
_FEED_STEMS = ("charge", "charging", "carga", "carica", "gavage")
"""Beginnings of words that next to a pressure or temperature name the feed circuit, not a load."""
_OF_THE_HYDRAULICS = frozenset(
    {
        *("hydraulic", "hydraulics", "hydraulisch", "hydr", "hyd"),
        *("hydrostatic", "hydrostat", "hydrostatisch", "hydraulique", "hydraulik"),
        *("hidraulico", "hidraulica", "idraulico", "idraulica", "\u6db2\u538b"),
    }
)
"""Next to a power or an efficiency these words name the hydraulic path alone."""
_MOTORS = frozenset({"motor", "moteur", "motore"})
"""These words, which may name the engine, name the hydraulic motor next to a stroke or the word
hydraulic."""

SYMBOLS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "n": ("speed",),
        "N": ("speed",),
        "w": ("speed",),
        "M": ("torque",),
        "m": ("torque",),
        "T": ("temperature", "torque"),
        "t": ("time", "temperature", "torque"),
        "P": ("power", "pressure"),
        "p": ("pressure", "power"),
        "Q": ("flow",),
        "q": ("flow",),
        "s": ("stroke",),
    }
)
"""Letters that stand for a quantity, the usual one first; a unit or another column decides."""
_SIDE_LETTERS = frozenset("aeio")
"""Letters that are a side of the transmission unless a word names it: then they count parts."""
_WEAK_SYMBOLS = frozenset("mTtPpsw")
"""Letters that alone, without a unit, do not name a quantity for sure."""


RULES: tuple[tuple[str, str, Heading], ...] = (
    *(
        (quantity.name, quantity.kind, heading)
        for quantity in QUANTITIES
        for heading in quantity.headings
    ),
    ("stage", "stage", Heading()),
)
"""Quantity, what it measures, and a heading that names it."""


def _is_named_by(heading: Heading, means: Set[str], sides: Set[str]) -> bool:
    """Return whether a name of the same kind with these meanings is a heading of a quantity."""
    if heading.side and heading.side not in sides:
        return False
    if heading.needs and means.isdisjoint(heading.needs):
        return False
    return means.isdisjoint(heading.excludes)


class Meaning(NamedTuple):
    """What the name of a column says.

    Attributes:
        quantity: named by a rule; `any_speed`, `any_torque`, `any_power` where the side is not
            said; `""` where no rule applies.
        kind: what is measured, `""` if nothing says so.
        unit: from the name or the row of units; None without one.
        unknown: words and brackets that are not understood.
        problem: why the column cannot be taken without asking; `""` for no problem.
        weak: whether only a letter of several uses names it.
        excluded: word that says that the column is none of the quantities; `""` for none.
    """

    quantity: str = ""
    kind: str = ""
    unit: Unit | None = None
    unknown: tuple[str, ...] = ()
    problem: str = ""
    weak: bool = False
    excluded: str = ""


_BRACKET = re.compile(r"[\[(<{\uff08\u3010]([^\])>}\uff09\u3011]*)[\])>}\uff09\u3011]")
_CHANNEL = re.compile(r"\b(?:ch|channel|kanal|voie|canal)\W*\d+\b", re.IGNORECASE)
"""Number of the channel of a data logger, which does not belong to the name."""
_MESSAGES = re.compile(r"^(?:[A-Z][A-Z\d]*\d\.)+(?=[A-Za-z])")
"""Bus and message in front of a signal, as in `CAN1.EEC1.EngineSpeed`."""
_DEVICE = re.compile(r"(?<=\w)\\[\w .-]+(?::\d+)?$")
"""Device behind a name, as INCA and asammdf write it: `EngineSpeed\\ETKC:1`."""
_PARTS = ("%", "\u2030", "ppm")
"""Units of a part of a whole; of speeds, torques and powers the whole is not stated."""
_PERCENT = frozenset({"percent", "pct", "prozent", "pourcent", "porciento"})
_DELIMITED = re.compile(r"(?:\s+in|\s*[,:;|]|\s/)\s+(\S+(?: \S+)?)$")
_SCALED = re.compile(
    r"[_ ](?:in |/ )?((?:x ?)?(?:10|100|1000|10\^3)[ x*]+[A-Za-z]\S*)$"
)
_SUFFIX = re.compile(
    r"[_ ]((?:rad|deg|rev)[_ ](?:per[_ ])?(?:sec|s|min)|k?N[_ ]m|deg[_ ][CF]|"
    r"[^_ ]+(?:[_ ]ft)?)$"
)


class _Parts(NamedTuple):
    """A header cell taken apart: its words, its unit, and a bracket that is no unit."""

    words: list[str]
    unit: Unit | None
    unread: tuple[str, ...] = ()


def _take_apart(cell: str) -> _Parts:
    """Split a cell of the header into words and unit."""
    cell = _DEVICE.sub("", _MESSAGES.sub("", _CHANNEL.sub(" ", cell)))
    unit: Unit | None = None
    unread: list[str] = []
    inner_words: list[str] = []
    brackets = list(_BRACKET.finditer(cell))
    bare = _BRACKET.sub(" ", cell).strip()
    for number, bracket in enumerate(reversed(brackets)):
        text = bracket[1].strip()
        known = usual_unit(text) if text else None
        tokens = words_of(text)
        # A sign that is neither a word nor a known unit may well be a unit.
        only_words = bool(tokens) or not text
        only_words &= all(meanings_of(token.lower()) for token in tokens)
        if known is None and only_words:
            inner_words += tokens
            continue
        known = known or unit_of(text)
        if known is not None and (number == 0 or unit is None):
            unit = known
        else:
            unread.append(bracket[0])
    if unit is not None or brackets:
        return _Parts([*words_of(bare), *inner_words], unit, tuple(unread))
    return _without_suffix(bare)


def _without_suffix(name: str) -> _Parts:
    """Split off a unit that follows the name without brackets, as in `n_engine_rpm`."""
    scaled = _SCALED.search(name)
    if scaled is not None:
        known = unit_of(scaled[1])
        if known is not None:
            return _Parts(words_of(name[: scaled.start()]), known)
    delimited = _DELIMITED.search(name)
    if delimited is not None:
        known = usual_unit(delimited[1])
        if known is not None:
            return _Parts(words_of(name[: delimited.start()]), known)
    suffix = _SUFFIX.search(name)
    if suffix is None:
        return _Parts(words_of(name), None)
    known = usual_unit(suffix[1])
    if known is None or suffix[1].isdigit():
        return _Parts(words_of(name), None)
    before = words_of(name[: suffix.start()])
    if _is_unit_suffix(suffix[1], known, before):
        return _Parts(before, known)
    return _Parts(words_of(name), None)


_INDICES = ("in", "h", "s", "m")
"""Endings that are an index of a shaft, or part of a name, before they are a unit."""


def _is_unit_suffix(text: str, unit: Unit, before: list[str]) -> bool:
    """Return whether the last word of a name is a unit of what the words before it name.

    Args:
        text: last word.
        unit: that it may be.
        before: words before it.
    """
    kinds = _kinds(before)
    of_part = unit.kind == "part" and bool(kinds & {"efficiency", "stroke"})
    only_speed = not kinds and unit.kind == "speed" and len(text) > 2
    if unit.kind not in kinds and not of_part and not only_speed:
        return False
    if unit.kind in ("temperature", "time"):
        return True
    letter = len(text) < 2 and text not in _PARTS
    is_index = text.lower() in _INDICES or (letter and not _named(before))
    return not is_index


def _named(tokens: list[str]) -> bool:
    """Return whether a name says more than a letter."""
    return any(len(token) > 1 for token in tokens)


def _kinds(tokens: list[str]) -> set[str]:
    """Return what the words of a name measure; symbols count only where no word does."""
    kinds = _word_kinds(tokens)
    if kinds:
        return kinds
    for token in tokens:
        kinds.update(SYMBOLS.get(token, ()))
    return kinds


def _word_kinds(tokens: list[str]) -> set[str]:
    """Return what the words of a name measure that are no symbols."""
    kinds: set[str] = set()
    for token in tokens:
        if token not in SYMBOLS:
            kinds.update(meanings_of(token.lower()))
    return kinds & set(KINDS)


@lru_cache(maxsize=4096)
def meaning_of(name: str, unit_below: str = "") -> Meaning:
    """Return what a header cell means.

    Args:
        name: cell of the header.
        unit_below: cell of the row of units; it adds to the name and never shortens it.
    """
    parts = _take_apart(name)
    below = None
    if unit_below:
        below = unit_of(unit_below)
    unit = parts.unit or below
    kind, weak, clash = _kind(parts.words, unit)
    if clash:
        return Meaning("", kind, unit, parts.unread, clash)
    means, strange = _meanings(parts.words, kind)
    unknown = (*parts.unread, *strange)
    problem = _unit_clash(parts.unit, below)
    words = [word.lower() for word in parts.words]
    # What a heading needs does not contradict its quantity.
    claimed, needed = _claimed(kind, means)
    excluding = _excluding(parts.words, kind, means - needed)
    if excluding:
        return Meaning("", kind, unit, unknown, problem, excluded=excluding)
    if kind in SHAFT_KINDS and not _PERCENT.isdisjoint(words) and unit is None:
        problem = f"it is in percent, of a {kind} that the table does not state"
        return Meaning("", kind, unit, unknown, problem)
    if kind == "time" and unknown and "time" not in _kinds(parts.words):
        # A duration in a name that is not understood, such as the length of a pulse.
        return Meaning("", kind, unit, unknown, problem)
    quantity, side_problem = claimed, ""
    if not claimed:
        quantity, side_problem = _by_rules(kind, means, words)
    clash = _kinds_clash(quantity, kind, words)
    problem = problem or side_problem or clash
    return Meaning(quantity, kind, unit, unknown, problem, weak)


_RATIOS = ("ratio", "verhaeltnis", "taux", "rapport", "rapporto", "relacion")
"""Words of a ratio, which of shafts is none of the quantities."""


def _excluding(words: list[str], kind: str, means: Set[str]) -> str:
    """Return the word of a name that says that it is none of the quantities; `""` for none.

    Args:
        words: of the name.
        kind: what is measured.
        means: meanings of the words.
    """
    against = {"other"} & means
    if kind != "torque":
        against |= {"loss"} & means
    listed: Set[str] = frozenset()
    if kind == "efficiency":
        listed = _OF_A_PART | _OF_THE_HYDRAULICS
        sides = means & {"engine", "output", "load", "pump"}
        if len(sides) == 1:  # that of the transmission is from one side to the other
            against |= sides
    elif kind in SHAFT_KINDS:
        listed = _DIFFERENCE
        against |= means & {"pump", "charge_pressure", "oil", "std"}
        if kind == "power":
            listed = listed | _OF_THE_HYDRAULICS
    elif kind == "stroke":
        listed = _MOTORS
    lowered = [word.lower() for word in words]
    if kind in SHAFT_KINDS and not _OF_THE_HYDRAULICS.isdisjoint(lowered):
        listed = listed | _MOTORS
    for word, low in zip(words, lowered, strict=True):
        if low == "operating" and "point" in lowered:
            continue
        if _is_or_begins_with(low, listed) or against & set(meanings_of(low)):
            return word
        if low.endswith(_RATIOS) and kind not in ("stroke", "efficiency"):
            return word
    return ""


def _is_or_begins_with(word: str, listed: Set[str]) -> bool:
    """Return whether a word is listed, or composed of a listed one and others."""
    if word in listed:
        return True
    if word in MEANINGS or not meanings_of(word):
        return False
    beginnings = [
        part for part in listed if part in COMPOUND_PARTS and word.startswith(part)
    ]
    return bool(beginnings)


def _kinds_clash(quantity: str, kind: str, words: list[str]) -> str:
    """Say that a name measures two things, as in `stroke pressure`; `""` for one.

    Args:
        quantity: that the rules give.
        kind: what is measured.
        words: of the name, in lower case.
    """
    if kind not in (*SHAFT_KINDS, "efficiency", "stroke") or not quantity:
        return ""
    others = _word_kinds(words) - {kind}
    if not others:
        return ""
    return f"its name says {kind} and {' and '.join(sorted(others))}"


def _unit_clash(in_name: Unit | None, below: Unit | None) -> str:
    """Say how the unit of the name and that of the row of units differ; `""` if they agree."""
    if in_name is None or below is None:
        return ""
    if below == in_name or below.name == "-" or _same_size(in_name, below):
        return ""
    return f"the header says {in_name.name}, the row of units {below.name}"


def _same_size(one: Unit, other: Unit) -> bool:
    """Return whether two units are one, as `rpm` and `1/min`."""
    if one.kind != other.kind or one.kind not in KIND_UNITS:
        return False
    try:
        return to_si(one.kind, one.name) == to_si(other.kind, other.name)
    except KeyError:
        return False


def _kind(words: list[str], unit: Unit | None) -> tuple[str, bool, str]:
    """Return what is measured, whether only a letter says so, and a clash of words and unit."""
    kinds = _kinds(words)
    by_letter = bool(kinds) and not _word_kinds(words)
    if unit is not None and unit.kind not in ("part", "other"):
        clash = _kind_clash(kinds, by_letter, unit)
        if not clash:
            return unit.kind, False, ""
        named = " or ".join(sorted(kinds))
        if unit.kind == "speed" and not by_letter:
            named = ""
        return named, False, clash
    if not kinds:
        return "", False, ""
    if not by_letter:
        kind = next(kind for kind in KINDS if kind in kinds)
        return _checked_part(kind, unit)
    letter = next(word for word in words if word in SYMBOLS)
    return SYMBOLS[letter][0], letter in _WEAK_SYMBOLS, ""


def _kind_clash(kinds: set[str], by_letter: bool, unit: Unit) -> str:
    """Say how what a name measures differs from its unit; `""` if it does not."""
    if not kinds or unit.kind in kinds:
        return ""
    if unit.kind == "speed" and not by_letter:
        return f"the name does not name a speed, its unit is {unit.name}"
    named = " or ".join(sorted(kinds))
    return f"the name says {named}, its unit is {unit.name}"


def _checked_part(kind: str, unit: Unit | None) -> tuple[str, bool, str]:
    wrong = unit is not None and (
        unit.kind == "other"
        or (unit.name in _PARTS and kind in ("speed", "torque", "power"))
    )
    if wrong and unit is not None and kind != "stage":
        return kind, False, f"its unit is {unit.name}"
    return kind, False, ""


def _meanings(words: list[str], kind: str) -> tuple[set[str], list[str]]:
    """Return the meanings of the words of a name, and the words without one."""
    means: set[str] = set()
    strange = []
    lowered = [word.lower() for word in words]
    side_by_word = _names_side(lowered)
    for word, low in zip(words, lowered, strict=True):
        if word in SYMBOLS and kind in SYMBOLS[word]:
            continue
        if side_by_word and low in _SIDE_LETTERS:
            strange.append(word)
            continue
        if low == "motor" and _GERMANIC_KINDS & set(lowered):
            means.add("engine")
            continue
        found = meanings_of(low)
        if found:
            means |= set(found)
        else:
            strange.append(word)
    if strange:
        # In a name that is not understood, a letter may count machines or phases.
        means -= _sides_by_letter(lowered)
    if kind in ("pressure", "temperature") and any(
        word.startswith(_FEED_STEMS) for word in lowered
    ):
        means.add("charge_pressure")
    if kind == "pressure" and not _PORTS.isdisjoint(lowered):
        means.add("one_side")
    # A temperature of the gearbox or the hydraulics is that of their oil.
    if kind == "temperature" and not _OIL_PLACES.isdisjoint(lowered):
        means.add("oil")
    return means, strange


def _names_side(words: list[str]) -> bool:
    """Return whether a word longer than a letter names a side of the transmission."""
    for word in words:
        sides = {"engine", "output", "load"} & set(meanings_of(word))
        if sides and word not in _SIDE_LETTERS:
            return True
    return False


def _sides_by_letter(words: list[str]) -> set[str]:
    """Return the sides of the transmission that only single letters of a name say."""
    by_letter: set[str] = set()
    by_word: set[str] = set()
    for word in words:
        if word in _SIDE_LETTERS:
            by_letter.update(meanings_of(word))
        else:
            by_word.update(meanings_of(word))
    return by_letter - by_word


def _claimed(kind: str, means: set[str]) -> tuple[str, set[str]]:
    """Return the quantity of which a heading needs a meaning, and what it needs; `""` for none."""
    sides = means & {"engine", "output", "load"}
    for quantity, measured, heading in RULES:
        if heading.needs and measured == kind and _is_named_by(heading, means, sides):
            return quantity, set(heading.needs)
    return "", set()


def _by_rules(kind: str, means: set[str], words: list[str]) -> tuple[str, str]:
    """Return the quantity that the rules give, and what stays open about the side.

    Args:
        kind: what is measured.
        means: meanings of the words.
        words: of the name, in lower case.
    """
    sides = means & {"engine", "output", "load"}
    if kind in SHAFT_KINDS:
        if sides == {"engine", "output"}:
            sides = _one_of_two(words)
        if not sides and "loss" not in means:
            return f"any_{kind}", ""
        if len(sides) > 1:
            return f"any_{kind}", "names two sides of the transmission"
    if kind == "pressure" and "one_side" in means and not _says_difference(words):
        return "", "it may be the pressure of one side, not high minus low"
    if kind == "temperature" and not _may_be_of_oil(means, words):
        return "", ""
    for quantity, measured, heading in RULES:
        if measured == kind and _is_named_by(heading, means, sides):
            return quantity, ""
    return "", ""


_AT_THE_OUTPUT = frozenset(
    {"uscita", "salida", "sortie", "output", "outlet", "abtrieb", "ausgang"}
)


def _one_of_two(words: list[str]) -> set[str]:
    """Return the side of a name in which a word of the other one is a preposition.

    Args:
        words: of a name that says engine and output, in lower case.
    """
    if "of the engine" in " ".join(words):
        return {"engine"}
    engine = {word for word in words if "engine" in meanings_of(word)}
    if engine == {"in"} and not _AT_THE_OUTPUT.isdisjoint(words):
        return {"output"}  # as in `coppia in uscita`
    return {"engine", "output"}


def _says_difference(words: list[str]) -> bool:
    """Return whether a name says that it is a difference, as in `system dp`."""
    return _SAYS_DIFFERENCE.search(" ".join(words).lower()) is not None


_SAYS_DIFFERENCE = re.compile(
    r"\b(d|dp|delta\w*|diff\w*|diferenc\w*|druckdifferenz)\b|\u538b\u5dee"
)


def _may_be_of_oil(means: set[str], words: list[str]) -> bool:
    """Return whether a temperature may be that of the oil of the transmission."""
    if means & {"output", "load"}:
        return False
    several = len([word for word in words if word.isalpha()]) > 1
    return "oil" in means or not several


def names_quantity(cell: str) -> str:
    """Return the quantity or kind of shaft that a header cell names; `""` for none."""
    meaning = meaning_of(cell)
    return meaning.quantity if meaning.quantity else ""


def file_says_efficiency(name: str) -> bool:
    """Return whether the name of a file or sheet says that it holds efficiencies."""
    words = {word.lower() for word in words_of(name)}
    return not words.isdisjoint(_EFFICIENCY_OF_FILES)


_EFFICIENCY_OF_FILES = frozenset(
    {"efficiency", "efficiencies", "eff", "eta", "wirkungsgrad", "\u6548\u7387"}
)
_UNIT_BENCH = (
    ("volumetric_efficiency", "efficiency", "volumetric volumetrisch vol volumetrique"),
    (
        "mechanical_efficiency",
        "efficiency",
        "mechanical mechanisch mech hydromechanical mecanique hydraulisch",
    ),
    ("overall_efficiency", "efficiency", "overall total gesamt \u603b\u6548\u7387"),
    ("flow_loss", "flow", "loss losses verlust leakage leckage"),
    ("torque_loss", "torque", "loss losses verlust friction reib"),
    ("oil_temperature", "temperature", "oil oel \u6cb9\u6e29"),
)
"""Quantities of the bench of one pump or motor that a further word distinguishes."""
_UNIT_BENCH_PLAIN = ("flow", "torque", "speed", "pressure", "temperature")
_UNIT_BENCH_WORDS = frozenset(
    {
        *("pump", "pumpe", "motor", "unit", "shaft", "delivered", "discharge"),
        *("effective", "actual", "measured", "differential", "difference", "delta"),
        *("d", "stroke", "output"),
    }
)


def unit_bench_meaning(name: str) -> tuple[str, Unit | None]:
    """Return the quantity that a column of the bench of one unit holds, and its unit.

    Args:
        name: cell of the header.

    Returns:
        `""` for a name that is not understood in every word.
    """
    parts = _take_apart(name)
    if parts.unread:
        return "", parts.unit
    kind = _unit_bench_kind(parts)
    if not kind:
        return "", parts.unit
    words = {word.lower() for word in parts.words}
    others = set()
    for word in words:
        is_symbol = word in SYMBOLS or word.upper() in SYMBOLS
        if kind not in meanings_of(word) and not is_symbol:
            others.add(word)
    return _unit_bench_quantity(kind, words, others), parts.unit


def _unit_bench_kind(parts: _Parts) -> str:
    """Return what a column of the bench of one unit measures; `""` if that is not sure."""
    if parts.unit is not None and parts.unit.kind in ("displacement", "flow"):
        return parts.unit.kind
    kind, weak, clash = _kind(parts.words, parts.unit)
    if weak or clash:
        return ""
    if kind == "stroke":
        return "displacement_ratio"
    return kind


def _unit_bench_quantity(kind: str, words: set[str], others: set[str]) -> str:
    """Return the quantity of a kind that the words name; `""` if one is not understood.

    Args:
        kind: what is measured.
        words: of the name, in lower case.
        others: those of them that do not name the kind.
    """
    for quantity, of_kind, listed in _UNIT_BENCH:
        if kind != of_kind:
            continue
        starts = tuple(listed.split())
        further = {word for word in words if word.startswith(starts)}
        if further and others <= further | _UNIT_BENCH_WORDS:
            return quantity
    for word in others - _UNIT_BENCH_WORDS:
        if "stroke" not in meanings_of(word):
            return ""
    if kind == "temperature":
        return "oil_temperature"
    if kind in (*_UNIT_BENCH_PLAIN, "displacement", "displacement_ratio"):
        return kind
    return ""

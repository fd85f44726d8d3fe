# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which column holds which quantity: a proposal with reasons, and questions where it is open.

Each column becomes at most one candidate. The best candidate of a quantity is proposed; a
second one of equal rank, a side that is not said, a unit that is not known or a number that can be
read in two ways is a question, with the option that answers it.
"""

import re
import shlex
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.files.numbers import no_number
from hmcvt_core.transmission.quantities import BY_NAME, QUANTITIES
from hmcvt_core.transmission.ranges import Array
from hmcvt_core.transmission.units import UNITS, kind_of, plain_text

from .header import RawTable
from .numbers import Numbers, Style, finite_share, not_available
from .rules import SHAFT_KINDS, Meaning, file_says_efficiency, meaning_of
from .stamps import DATE_ORDERS, Times, read_times
from .units import to_si, unit_of

INPUTS = ("engine_torque", "engine_power")
OUTPUTS = ("load_torque", "output_torque", "output_power", "torque_loss")
_OF_OUTPUT = ("load_torque", "output_torque", "output_power")
# A quantity that the others already give is compared with them instead, the first one first.
_SPARE = (
    "torque_loss",
    "engine_power",
    "engine_torque",
    "output_power",
    "load_torque",
    "output_torque",
)
_LOADS = ("load_torque", "output_torque")
BY_RANGE = "values lie in the usual range"
"""Reason of a unit that the table does not state."""
_PERCENT_FROM = 60.0
"""Largest stroke in percent that some test exceeds: angles, millimetres and cm3 stay below it."""
_NEUTRAL_OPEN = "is the pump in neutral at 0 or in the middle of the range"
_ANGLE = re.compile(
    r"alpha|angle|angul|swash|swivel|schwenk|winkel|plateau|\u659c\u76d8|\u89d2"
)


class _Likely(NamedTuple):
    """A unit that is likely for numbers without one, by their largest size."""

    kind: str
    unit: str
    above: float
    up_to: float


_LARGEST_FRACTION = 1.5
"""Number up to which a part is a fraction; above it is in percent."""
_LIKELY_UNITS = (
    _Likely("part", "-", -1.0, _LARGEST_FRACTION),
    _Likely("part", "%", _LARGEST_FRACTION, np.inf),
    _Likely("speed", "rad/s", -1.0, 320.0),
    _Likely("speed", "rpm", 320.0, np.inf),
    _Likely("torque", "N m", 60.0, np.inf),
)
"""Smaller torques are asked, and powers, since PS and hp are near kW. A tractor's engine turns at
most at 320 rad/s, and slower than that in r/min only at idle."""
_NAMES_OF_STAGE = ("gear", "range", "gear range", "speed range")
"""Names of the column of stages; within a longer name these words mean something else."""
OPTIONAL = tuple(
    quantity.name
    for quantity in QUANTITIES
    if quantity.stored and (quantity.joint or quantity.name == "stamp")
)
"""Quantities that samples do without, and that do not make up the power."""
_DECIMALS = ("--decimal point", "--decimal comma")
_FASTEST_OUTPUT = 450.0
"""Up to this number a speed of an output shaft may be in rad/s [rad/s]: 4,300 r/min."""
_SAME = 1e-9
"""Fraction by which one value in two units differs at most, by rounding of floating point."""
_SAME_TIME = 0.5
"""Seconds by which two clocks of one recording differ at most."""
_LONG_TABLE = 30
"""Rows from which a time without a unit is asked, since the table may be a recording."""


class Column(NamedTuple):
    """Where a quantity stands.

    Attributes:
        name: of the column.
        unit: in which its numbers are; `""` for times and stages whose text says all.
        why: reason where it was proposed, `""` where the user named it.
    """

    name: str
    unit: str
    why: str = ""


class Question(NamedTuple):
    """What the table leaves open, and the options that answer it, the first an example."""

    text: str
    options: tuple[str, ...] = ()

    def __str__(self) -> str:
        if not self.options:
            return self.text
        return f"{self.text}: add {' or '.join(self.options)}"


@dataclass(frozen=True)
class Proposal:
    """Columns by quantity, and what is open.

    Attributes:
        columns: named by the user or proposed.
        spares: proposed for quantities that others already give, to be compared with them.
        questions: to be answered before the proposal may be taken.
        notes: columns that were left aside, with the reason.
        assumed: units of torques and powers that nothing states.
    """

    columns: dict[str, Column]
    spares: dict[str, Column]
    questions: tuple[Question, ...]
    notes: tuple[str, ...]
    assumed: tuple[str, ...] = ()

    def missing_anyway(self) -> list[str]:
        """Return what bench samples still need when all questions are answered."""
        answered = set(self.columns)
        for question in self.questions:
            for answer in question.options:
                words = answer.removeprefix("--").split()
                answered.add(words[0].replace("-", "_"))
        return missing_quantities(answered)


class _Candidate(NamedTuple):
    """A column that may hold a quantity; `rank` sorts candidates, the best highest."""

    name: str
    quantity: str
    unit: str
    why: str
    rank: tuple[bool, bool, int, bool]
    doubt: str = ""
    values: Array | None = None


def option(quantity: str, column: str, unit: str = "") -> str:
    """Return the option that names a column of a quantity."""
    text = f"{column}:{unit}" if unit else column
    return f"--{quantity.replace('_', '-')} {shlex.quote(text)}"


def missing_quantities(columns: Set[str]) -> list[str]:
    """Return what bench samples still need in addition to these quantities."""
    into = columns & set(INPUTS)
    out = columns & set(OUTPUTS)
    if "engine_torque" not in columns:
        out = out - {"torque_loss"}
    missing = [
        name for name in ("displacement_ratio", "engine_speed") if name not in columns
    ]
    if "output_torque" in out and "output_speed" not in columns:
        missing.append("load_torque (or output_speed)")
    elif not out and not (into and "efficiency" in columns):
        missing.append(
            "load_torque (or output_power, or output_torque and output_speed)"
        )
    if not into and "efficiency" not in columns:
        missing.append("efficiency (or engine_torque or engine_power)")
    return missing


def named_column(quantity: str, text: str, table: RawTable) -> Column:
    """Return what `COLUMN` or `COLUMN:UNIT` names; a column may hold a colon itself.

    Without a unit, that of the header or of the row of units holds, else the first of `UNITS`.

    Raises:
        InputError: the column is missing, or the unit is not one of the quantity.
    """
    whole = text.strip()
    name, _, unit = (part.strip() for part in text.rpartition(":"))
    if whole in table.columns:
        return Column(whole, _unit_of_header(quantity, whole, table))
    if name not in table.columns:
        raise InputError(
            f"{table.source}: {quantity}: column {(name if ':' in whole else whole)!r} "
            f"is missing; there is {', '.join(table.columns)}"
        )
    if quantity == "stamp" and unit in DATE_ORDERS:
        return Column(name, unit)
    for known in UNITS.get(quantity, {"": 1.0}):
        if unit.casefold() == known.casefold():
            return Column(name, known)
    try:
        to_si(kind_of(quantity), unit)
    except KeyError:
        raise InputError(
            f"{quantity}: {unit!r} is no unit of it; there is "
            f"{', '.join(UNITS.get(quantity, ()))}"
        ) from None
    return Column(name, unit)


def _unit_of_header(quantity: str, name: str, table: RawTable) -> str:
    """Return the unit of a column that was named without one."""
    if quantity == "stage":
        return ""
    first = next(iter(UNITS[quantity]))
    meaning = meaning_of(name, table.units.get(name, ""))
    unit = meaning.unit
    if quantity == "stamp":
        known = unit is not None and unit.kind == "time"
        return unit.name if known and unit is not None else ""
    if meaning.problem.startswith("the header says"):
        raise InputError(
            f"{table.source}: {quantity}: column {name!r}: {meaning.problem}; write "
            f"{name}:UNIT"
        )
    if unit is None or unit.name == "-":
        brackets = _brackets(meaning)
        if brackets:
            raise InputError(
                f"{table.source}: {quantity}: the unit {brackets[0]} in column {name!r} is "
                f"not known; write {name}:UNIT, one of {', '.join(UNITS[quantity])}"
            )
        return first
    try:
        to_si(kind_of(quantity), unit.name)
    except KeyError:
        raise InputError(
            f"{table.source}: {quantity}: the header says {unit.name} in column {name!r}, "
            f"which is not in {first}; write {name}:UNIT, one of "
            f"{', '.join(UNITS[quantity])}"
        ) from None
    return unit.name


def propose(
    table: RawTable, given: Mapping[str, Column], averaged: bool = False
) -> Proposal:
    """Propose columns for the quantities that the user did not name.

    Args:
        table: as text.
        given: columns that the user named.
        averaged: whether each row is a steady test, so that samples do without a time.
    """
    candidates, notes = _all_candidates(table, given)
    proposed: dict[str, Column] = {}
    questions: dict[str, Question] = {}
    for quantity, rivals in candidates.items():
        if quantity.startswith("any_"):
            continue
        rivals.sort(key=lambda rival: rival.rank, reverse=True)
        best = rivals[0]
        proposed[quantity] = Column(best.name, best.unit, best.why)
        question = _question(quantity, rivals)
        if question is not None:
            questions[quantity] = question
    _same_speed_units(proposed, given, candidates, questions)
    of_map = bool(table.matrix)  # its axis is a quantity, whatever else is in its cells
    _assign_sides(candidates, proposed, given, questions, notes, of_map)
    _ask_torque_of_load(proposed, given, questions)
    spares = _take_spares(proposed, given)
    if not {*proposed, *given, *spares}.isdisjoint(_OF_OUTPUT):
        spares.pop("torque_loss", None)  # it may be one of the output shaft
    doubtful = {name for name in spares if name in questions}
    for name in doubtful:
        del spares[name]
    notes += _excluded(table, {*given, *proposed})
    # A doubt about what samples do without is a note; tests do without a time.
    aside = ["stage", *OPTIONAL]
    if not averaged:
        aside.remove("stamp")
    notes += _without_optional(aside, proposed, questions)
    _merge_decimals(questions)
    open_questions = []
    for name, question in questions.items():
        if name in proposed or name in doubtful or name.startswith("any_"):
            open_questions.append(question)
    open_questions += _loads_by_letter(table, proposed, given, spares)
    return Proposal({**given, **proposed}, spares, tuple(open_questions), tuple(notes))


def _all_candidates(
    table: RawTable, given: Mapping[str, Column]
) -> tuple[dict[str, list[_Candidate]], list[str]]:
    """Return the candidates of every quantity, and why columns were refused."""
    named = {column.name for column in given.values()}
    candidates: dict[str, list[_Candidate]] = {}
    notes = []
    for name in table.columns:
        if name in named:
            continue
        candidate, note = _candidate(name, table)
        if name in table.hidden:
            if candidate is not None:
                notes.append(f"column {name!r} is not used: the sheet hides it")
            continue
        if candidate is not None and candidate.quantity not in given:
            candidates.setdefault(candidate.quantity, []).append(candidate)
        if note:
            notes.append(note)
    return candidates, notes


def _excluded(table: RawTable, known: Set[str]) -> list[str]:
    """Return why columns of the kinds that are missing are not used.

    Args:
        table: as text.
        known: quantities that have a column.
    """
    missing = " ".join(missing_quantities(known)).replace("displacement", "stroke")
    notes = []
    for name in table.columns:
        meaning = meaning_of(name, table.units.get(name, ""))
        if not meaning.excluded or not meaning.kind or meaning.kind not in missing:
            continue
        answer = ""
        quantity = {"stroke": "displacement_ratio"}.get(meaning.kind, meaning.kind)
        if quantity in UNITS:
            unit = meaning.unit.name if meaning.unit is not None else ""
            answer = f" ({option(quantity, name, unit)} uses it)"
        notes.append(
            f"column {name!r} is not used: its name says {meaning.excluded!r}{answer}"
        )
    return notes


def _without_optional(
    optional: Sequence[str],
    proposed: dict[str, Column],
    questions: dict[str, Question],
) -> list[str]:
    """Remove doubtful quantities that samples do without; return a note for each."""
    notes = []
    for quantity in optional:
        if quantity in questions:
            notes.append(f"left aside: {questions.pop(quantity)}")
            del proposed[quantity]
    return notes


def _quantity(name: str, meaning: Meaning) -> str:
    """Return the quantity that a name means; `""` for none."""
    if name.strip().lower() in _NAMES_OF_STAGE:
        return "stage"
    return meaning.quantity


def _candidate(name: str, table: RawTable) -> tuple[_Candidate | None, str]:
    """Return what a column may hold, and a note where it was refused."""
    below = table.units.get(name, "")
    meaning = meaning_of(name, below)
    of_file = _is_value_of_map(name, table)
    if of_file:
        meaning = meaning_of("efficiency", below)
    quantity = _quantity(name, meaning)
    if not quantity:
        if meaning.problem and meaning.kind:
            return None, f"column {name!r} is not used: {meaning.problem}"
        return None, ""
    if quantity == "stage":
        return _Candidate(name, quantity, "", "name", _rank(True, meaning, True)), ""
    if quantity == "stamp":
        return _time_candidate(name, meaning, table)
    if finite_share(table.numbers(name).values) == 0.0:
        return None, _no_numbers(name, quantity, table)
    candidate = _candidate_of_numbers(name, meaning, table)
    if of_file:
        candidate = candidate._replace(why=f"name of the file, {candidate.why}")
    return candidate, ""


def _candidate_of_numbers(name: str, meaning: Meaning, table: RawTable) -> _Candidate:
    """Return what a column of numbers may hold, with its unit and the doubt about it."""
    quantity = meaning.quantity
    numbers = table.numbers(name)
    choice = _unit(quantity, meaning, table.units.get(name, ""), numbers)
    if choice == _UnitChoice("%", "cells") and _percent_by_sign(name, table):
        choice = _UnitChoice("-", "cells, those with % in percent")
    doubt = _doubt(name, meaning, table.styles[name], choice)
    if not doubt and choice.why == BY_RANGE and kind_of(quantity) == "torque":
        doubt = _unusual_unit_doubt(name, table)
    if quantity == "displacement_ratio" and not doubt:
        if choice.why == BY_RANGE:
            doubt = _stroke_doubt(name, numbers.values)
        doubt = doubt or _neutral_doubt(name, choice.unit, numbers.values, table)
    fits = _mostly_in_range(quantity, choice.unit, numbers.values)
    rank = _rank(fits, meaning, choice.why != BY_RANGE)
    return _Candidate(
        name, quantity, choice.unit, choice.why, rank, doubt, numbers.values
    )


def _percent_by_sign(name: str, table: RawTable) -> bool:
    """Return whether only the cells with a sign are in percent, and the others are fractions."""
    cells = table.columns[name]
    plain = [index for index, cell in enumerate(cells) if not cell.endswith("%")]
    values = table.numbers(name).values[plain]
    known = values[np.isfinite(values)]
    return bool(len(known) and np.max(np.abs(known)) <= _LARGEST_FRACTION)


def _is_value_of_map(name: str, table: RawTable) -> bool:
    """Return whether a column without a name holds the efficiency that the file is named for.

    That is so in a map of one quantity over two axes: the other two columns name a speed and a
    torque, and the last one has no name.
    """
    if name not in table.without_name:
        return False
    measured = []
    for other, cells in table.columns.items():
        if set(cells) != {other}:  # a number for all rows is no column of the file
            measured.append(other)
    if len(measured) != 3 or measured[-1] != name:
        return False
    kinds = {meaning_of(other, table.units.get(other, "")).kind for other in measured}
    of_axes = {"speed", "torque"} <= kinds
    return of_axes and file_says_efficiency(Path(table.source).stem)


def _no_numbers(name: str, quantity: str, table: RawTable) -> str:
    """Say why a column without any number is refused."""
    filled = [cell for cell in table.columns[name] if cell]
    texts = [cell for cell in filled if not not_available(cell)]
    reason = "it is empty"
    if texts:
        reason = f"cell {texts[0]!r} is no number"
        if texts[0].startswith("="):
            reason = no_number("its cell", texts[0])
    elif filled:
        reason = f"all its cells are codes for no value, such as {filled[0]!r}"
    return f"column {name!r} would be {_words(quantity)}, but {reason}"


def _doubt(name: str, meaning: Meaning, style: Style, choice: "_UnitChoice") -> str:
    """Return the strongest doubt about a column of numbers; `""` for none."""
    if style.doubtful:
        return f"column {name!r}: {style.doubtful!r} can be read in two ways"
    brackets = _brackets(meaning)
    if brackets:
        return f"{brackets[0]} in column {name!r} is not known"
    if meaning.unknown:
        words = ", ".join(map(repr, meaning.unknown))
        return f"{words} in column {name!r} is not known"
    if meaning.weak:
        return f"column {name!r} may be a torque, a temperature, a pressure or a time"
    if meaning.problem:
        return f"column {name!r}: {meaning.problem}"
    if choice.doubt:
        return f"column {name!r}: {choice.doubt}"
    if not choice.unit:
        return f"column {name!r} names no unit"
    return ""


def unit_is_stated(name: str, table: RawTable) -> bool:
    """Return whether the name of a column, the row of units or its cells state its unit."""
    unit = meaning_of(name, table.units.get(name, "")).unit
    if unit is not None and unit.name != "-":
        return True
    return bool(table.numbers(name).units)


def _brackets(meaning: Meaning) -> list[str]:
    """Return the brackets of a name that hold no known unit."""
    return [text for text in meaning.unknown if not text[0].isalnum()]


def _mostly_in_range(quantity: str, unit: str, values: Array) -> bool:
    """Return whether most values of a column are plausible in a unit."""
    limits = BY_NAME.get(_with_side(quantity))
    if not unit or limits is None:
        return False
    inside = limits.contains(_in_si(quantity, unit, values))
    return bool(inside.mean() > 0.5)


def _in_si(quantity: str, unit: str, values: Array) -> Array:
    size, zero = to_si(kind_of(quantity), unit)
    return np.asarray(size * (values - zero))


def _stroke_doubt(name: str, values: Array) -> str:
    """Return why numbers of a stroke without unit may be neither a fraction nor percent."""
    largest = float(np.nanmax(np.abs(values)))
    if largest <= 1.5:
        return ""
    if largest < _PERCENT_FROM or _ANGLE.search(plain_text(name).lower()):
        return f"column {name!r} names no unit and may hold an angle or a length"
    return ""


_UNUSUAL = frozenset(
    {"lb ft", "lb in", "psi", "deg F", "gpm", "in3", "kNm", "daN m", "kgf m"}
)
"""Units of other columns next to which a torque without a unit may well not be in N m."""
_UNUSUAL_WORDS = re.compile(
    r"\b(lbs?|lbf|ft|in-?lbs?|imperial|us units|kn ?m|dan ?m|kgf|kp ?m)\b",
    re.IGNORECASE,
)


def _unusual_unit_doubt(name: str, table: RawTable) -> str:
    """Return why a torque without a unit may be in another one than N m."""
    said = _UNUSUAL_WORDS.search(table.above)
    if said is not None:
        return f"column {name!r} names no unit, and a line above says {said[0]!r}"
    for other in table.columns:
        meaning = meaning_of(other, table.units.get(other, ""))
        unit = meaning.unit
        if unit is None or meaning.weak or unit.name == "-":
            continue
        of_shaft = unit.kind in SHAFT_KINDS and not meaning.quantity.startswith("any_")
        if of_shaft or unit.name in _UNUSUAL:
            return f"column {name!r} names no unit, and {other!r} is in {unit.name}"
    return ""


def _neutral_doubt(name: str, unit: str, values: Array, table: RawTable) -> str:
    """Return why the neutral of a stroke may be in the middle of its range."""
    if name == "displacement_ratio" or not unit:
        return ""
    cells = table.columns[name]
    for index in np.flatnonzero(np.isnan(values)).tolist():
        if not not_available(cells[index]):
            return ""  # the sign of a cell that cannot be read is not known
    stroke = _in_si("displacement_ratio", unit, values)
    known = stroke[np.isfinite(stroke)]
    if known.min() < 0.0 or known.min() >= 0.5 or known.max() <= 0.5:
        return ""
    return f"column {name!r} is never negative: {_NEUTRAL_OPEN}"


def _merge_decimals(questions: dict[str, Question]) -> None:
    """Ask for the decimal sign once, since one answer holds for all columns."""
    asked = [name for name in questions if questions[name].options == _DECIMALS]
    for name in asked[1:]:
        first = questions[asked[0]]
        text = questions.pop(name).text.removesuffix(" can be read in two ways")
        begun = first.text.removesuffix(" can be read in two ways")
        questions[asked[0]] = first._replace(
            text=f"{begun}, {text} can be read in two ways"
        )


def _rank(
    fits: bool, meaning: Meaning, unit_stated: bool
) -> tuple[bool, bool, int, bool]:
    return fits, not meaning.weak, -len(meaning.unknown), unit_stated


def _words(quantity: str) -> str:
    return quantity.replace("any_", "a ").replace("_", " ")


def _with_side(quantity: str) -> str:
    """Return a quantity whose range holds for one of an unknown side."""
    sides = {
        "any_speed": "output_speed",
        "any_torque": "output_torque",
        "any_power": "output_power",
    }
    return sides.get(quantity, quantity)


class _UnitChoice(NamedTuple):
    """The unit of a column, what said so, and a doubt; `""` where there is none."""

    unit: str = ""
    why: str = ""
    doubt: str = ""


def _unit(quantity: str, meaning: Meaning, below: str, numbers: Numbers) -> _UnitChoice:
    """Return the unit by the name, the row of units, the cells or the size of the numbers."""
    kind = kind_of(quantity)
    if meaning.unit is not None and (meaning.unit.name != "-" or kind == "part"):
        why = "name"
        if unit_of(below) == meaning.unit:
            why = "row of units"
        return _checked_unit(kind, meaning.unit.name, why)
    if below and unit_of(below) is None:
        return _UnitChoice(doubt=f"the unit {below!r} in the row of units is not known")
    if numbers.units:
        return _checked_unit(kind, numbers.units[0], "cells")
    size = float(np.nanquantile(np.abs(numbers.values), 0.9))
    for likely in _LIKELY_UNITS:
        if likely.kind == kind and likely.above < size <= likely.up_to:
            return _UnitChoice(likely.unit, BY_RANGE)
    return _UnitChoice()


def _checked_unit(kind: str, unit: str, why: str) -> _UnitChoice:
    try:
        to_si(kind, unit)
    except KeyError:
        reason = "is no unit of it"
        if unit == "1/s":
            reason = "may count radians or turns"
        return _UnitChoice(doubt=f"unit {unit} {reason}")
    return _UnitChoice(unit, why)


def _time_candidate(
    name: str, meaning: Meaning, table: RawTable
) -> tuple[_Candidate | None, str]:
    unit = ""
    if meaning.unit is not None and meaning.unit.kind == "time":
        unit = meaning.unit.name
    times = read_times(table.columns[name], unit, table.styles[name].comma)
    readable = np.isfinite(times.seconds).any()
    if not (readable or times.question or times.unreadable):
        return None, ""
    doubt = _time_doubt(name, times)
    small = len(table.rows) < _LONG_TABLE
    if not times.scale_known and small:
        why = f"column {name!r} is not used as time: {times.question}"
        return None, f"{why} ({option('stamp', name, 'UNIT')} uses it)"
    unit_stated = bool(unit) or not times.dated
    rank = _rank(not times.dated, meaning, unit_stated)
    candidate = _Candidate(
        name, "stamp", times.unit or unit, "name", rank, doubt, times.seconds
    )
    return candidate, ""


def _time_doubt(name: str, times: Times) -> str:
    if times.unreadable and finite_share(times.seconds) < 0.5:
        return (
            f"column {name!r} is named as time, but {times.unreadable!r} cannot be read "
            "as a time"
        )
    if times.scale_known or not reads_as_seconds(times.seconds):
        return f"column {name!r}: {times.question}" if times.question else ""
    return ""


def reads_as_seconds(values: Array) -> bool:
    """Return whether numbers without a unit rise as the seconds of a recording do."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    if len(steps) < _LONG_TABLE - 1 or np.mean(steps >= 0.0) < 0.9:
        return False
    typical = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    # Faster than 1 kHz or slower than 2 s, the numbers may well count minutes or milliseconds.
    return 1e-3 <= typical <= 2.0 and typical != 1.0


def _question(quantity: str, rivals: list[_Candidate]) -> Question | None:
    """Return what is open about the best candidate of a quantity."""
    best = rivals[0]
    if best.doubt:
        return _question_of_doubt(quantity, best)
    others = [rival for rival in rivals[1:] if not _equal(rival, best)]
    equals = []
    for rival in others:
        # A unit that is not known hides whether the column is in range.
        unknown = rival.rank[1] and rival.doubt.endswith("is not known")
        is_word = rival.doubt.startswith(("'", '"'))
        states_unit = rival.rank[3]
        unit_unknown = unknown and not (is_word and states_unit)
        if rival.rank == best.rank or unit_unknown:
            equals.append(rival)
    if not equals:
        # A name that stands twice in the header is numbered by the reader.
        equals = [rival for rival in others if rival.name.startswith(f"{best.name} (")]
    if not equals:
        return None
    both = [best, *equals]
    names = " and ".join(repr(rival.name) for rival in both)
    answers = tuple(option(quantity, rival.name, rival.unit) for rival in both)
    return Question(f"columns {names} both name {_words(quantity)}", answers)


def _question_of_doubt(quantity: str, best: _Candidate) -> Question:
    """Return the question about the best candidate, with the options that answer it."""
    if "two ways" in best.doubt:
        return Question(best.doubt, _DECIMALS)
    choices = _two_units(quantity)
    unit_stated = best.rank[3]
    if unit_stated and best.unit:
        choices = (best.unit,)
    if quantity == "stamp":
        if "cannot be read" in best.doubt:
            return Question(f"{best.doubt} (--averaged takes each row as a test)")
        choices = ("s", "ms", "min", "h")
        if "day and month" in best.doubt:
            choices = ("dmy", "mdy")
    elif "radians or turns" in best.doubt:
        choices = ("rad/s", "turn/s")
    elif _NEUTRAL_OPEN in best.doubt:
        middle = {"%": ("%@50",), "-": ("-@0.5",)}
        choices = (best.unit, *middle.get(best.unit, ()))
    answers = tuple(option(quantity, best.name, unit) for unit in choices)
    return Question(best.doubt, answers)


def _two_units(quantity: str) -> tuple[str, ...]:
    """Return the first two units of a quantity that differ in size."""
    if kind_of(quantity) == "torque":
        return ("N m", "lb ft")
    units = UNITS.get(quantity, {})
    first_of_size: dict[float, str] = {}
    for unit, size in units.items():
        first_of_size.setdefault(size, unit)
    return tuple(first_of_size.values())[:2]


def _equal(one: _Candidate, other: _Candidate) -> bool:
    """Return whether two columns hold the same values, each in its unit."""
    if one.values is None or other.values is None:
        return False
    if one.quantity == "stamp":
        elapsed = one.values - one.values[0]
        also = other.values - other.values[0]
        return np.allclose(elapsed, also, atol=_SAME_TIME, equal_nan=True)
    if one.unit == other.unit:
        return np.array_equal(one.values, other.values, equal_nan=True)
    if not one.unit or not other.unit:
        return False
    first = _in_si(one.quantity, one.unit, one.values)
    second = _in_si(other.quantity, other.unit, other.values)
    return np.allclose(first, second, rtol=_SAME, atol=0.0, equal_nan=True)


def _same_speed_units(
    proposed: dict[str, Column],
    given: Mapping[str, Column],
    candidates: Mapping[str, list[_Candidate]],
    questions: dict[str, Question],
) -> None:
    """Take an output speed without unit in that of the engine: it may turn slowly.

    Where the size of its numbers may say another unit, only an efficiency by the shafts can confirm
    that, which the checks look at; else the unit is asked.
    """
    engine = proposed.get("engine_speed") or given.get("engine_speed")
    output = proposed.get("output_speed")
    if engine is None or output is None or output.why != BY_RANGE:
        return
    known = {*proposed, *given}
    confirmed = "output_torque" in known and bool(known & set(INPUTS))
    same = to_si("speed", output.unit) == to_si("speed", engine.unit or "rad/s")
    values = candidates["output_speed"][0].values
    if values is not None and to_si("speed", engine.unit or "rad/s")[0] < 1.0:
        same = same and float(np.nanmax(np.abs(values))) > _FASTEST_OUTPUT
    if not same and not confirmed:
        answers = tuple(
            option("output_speed", output.name, unit) for unit in ("rad/s", "rpm")
        )
        questions["output_speed"] = Question(
            f"column {output.name!r} names no unit", answers
        )
    proposed["output_speed"] = output._replace(unit=engine.unit)


def _ask_torque_of_load(
    proposed: Mapping[str, Column],
    given: Mapping[str, Column],
    questions: dict[str, Question],
) -> None:
    """Ask whether the torque of the load is that at the output shaft.

    A bench says "load torque" of its load machine; bench samples refer it to the engine. An
    efficiency together with an input decides, which the checks look at; where the output shaft
    has a torque of its name, that one is taken and the other is compared with it.
    """
    column = proposed.get("load_torque")
    known = {*proposed, *given}
    decided = "efficiency" in known and bool(known & set(INPUTS))
    decided = decided or "output_torque" in known
    if column is None or "output_speed" not in known or decided:
        return
    if column.name == "load_torque" or "load_torque" in questions:
        return
    answers = tuple(
        option(quantity, column.name, column.unit)
        for quantity in ("output_torque", "load_torque")
    )
    text = (
        f"column {column.name!r} may be the torque at the output shaft, or output power / "
        "engine speed"
    )
    questions["load_torque"] = Question(text, answers)


def _loads_by_letter(
    table: RawTable,
    proposed: Mapping[str, Column],
    given: Mapping[str, Column],
    spares: Mapping[str, Column],
) -> list[Question]:
    """Ask for columns such as `T_load` where an efficiency would give the load torque instead.

    The letter may be a torque or a temperature. An efficiency that the user names is taken, and so
    is a column of that letter.
    """
    measured = {*proposed, *given, *spares} & {*_LOADS, "output_power"}
    if measured or "efficiency" not in proposed:
        return []
    efficiency = proposed["efficiency"]
    settled = {column.name for column in given.values()} | {*table.hidden}
    questions = []
    for name in table.columns:
        if name in settled:
            continue
        meaning = meaning_of(name, table.units.get(name, ""))
        as_torque = meaning_of(name, "N m").quantity
        if not meaning.weak or meaning.unit is not None or as_torque not in _LOADS:
            continue
        answers = (
            option(as_torque, name, "N m"),
            option("efficiency", efficiency.name, efficiency.unit),
        )
        text = (
            f"column {name!r} may be a torque or a temperature, and column "
            f"{efficiency.name!r} would give the load torque"
        )
        questions.append(Question(text, answers))
    return questions


def _assign_sides(
    candidates: Mapping[str, list[_Candidate]],
    proposed: dict[str, Column],
    given: Mapping[str, Column],
    questions: dict[str, Question],
    notes: list[str],
    needed: bool,
) -> None:
    """Give columns that name no side a quantity where only one is possible, else ask.

    The only speed of a table is the engine's and the only torque the load's, as bench tables
    write them; with a second speed or torque the side is asked.
    """
    for kind in SHAFT_KINDS:
        rivals = candidates.get(f"any_{kind}", [])
        strong = []
        for rival in rivals:
            if rival.rank[1]:
                strong.append(rival)
            else:
                notes.append(
                    f"column {rival.name!r} is not used: it may be a torque, a "
                    "temperature, a pressure, a power or a time"
                )
        known = {*proposed, *given}
        if not strong:
            continue
        if not (needed or kind_needed(kind, set(missing_quantities(known)))):
            for rival in strong:
                notes.append(f"column {rival.name!r} names no side and is not used")
        elif _only_of_its_kind(kind, strong, known):
            _take_only(kind, strong, proposed, questions)
        else:
            questions[f"any_{kind}"] = _side_question(kind, strong)


_TARGETS = {"speed": "engine_speed", "torque": "load_torque"}
"""Quantity of the only speed and the only torque of a table."""


def _only_of_its_kind(kind: str, rivals: Sequence[_Candidate], known: Set[str]) -> bool:
    """Return whether a column without a side is the only one of its kind."""
    if kind not in _TARGETS or len(rivals) > 1 or "output_speed" in known:
        return False
    return not any(name.endswith(f"_{kind}") for name in known)


def _take_only(
    kind: str,
    rivals: list[_Candidate],
    proposed: dict[str, Column],
    questions: dict[str, Question],
) -> None:
    """Propose the only column of its kind, or ask where its name is not understood."""
    best = rivals[0]
    target = _TARGETS[kind]
    proposed[target] = Column(best.name, best.unit, f"{best.why}, the only {kind}")
    question = _question(target, rivals)
    if question is not None:
        questions[target] = question
    elif best.rank[2] < 0:
        questions[target] = _side_question(kind, rivals)


def kind_needed(kind: str, missing: Set[str]) -> bool:
    """Return whether what is missing could be a quantity of a kind."""
    if kind == "speed":
        return any("speed" in name for name in missing)
    return any("torque" in name or "power" in name for name in missing)


def _side_question(kind: str, rivals: list[_Candidate]) -> Question:
    names = " and ".join(repr(rival.name) for rival in rivals)
    verb = "do"
    if len(rivals) == 1:
        verb = "does"
    best = rivals[0]
    sides = ["engine", "output"]
    if kind == "torque":
        sides.append("load")
    answers = tuple(option(f"{side}_{kind}", best.name, best.unit) for side in sides)
    return Question(
        f"column {names} {verb} not say which side of the transmission it is of",
        answers,
    )


def _take_spares(
    proposed: dict[str, Column], given: Mapping[str, Column]
) -> dict[str, Column]:
    """Move quantities that the others already give out of the proposal."""
    spares = {}
    for quantity in _SPARE:
        all_names = {*proposed, *given}
        if quantity not in proposed:
            continue
        if missing_quantities(all_names - {quantity}) == missing_quantities(all_names):
            spares[quantity] = proposed.pop(quantity)
    return spares

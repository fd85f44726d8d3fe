# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Slip of open clutches, from the two shafts that each clutch lies between.

Without slip of oil every shaft speed of a stage is a linear function of engine speed and output
speed. A side of a clutch is a shaft and the gear pairs to the clutch:

* `engine`, `motor`, `output` and `housing`;
* `sun`, `ring` and `carrier` of the row of the stage engaged;
* `STAGE.sun`, `STAGE.ring` and `STAGE.carrier` of the row of another stage, which turns with engine
  and motor by the paths of that stage;
* `/PAIR` is the shaft behind a pair, seen from the engine; `*PAIR` is the shaft in front of it; a
  minus at the beginning reverses the sense.

So `HM2.ring/6/7` is the shaft behind the pairs 6 and 7, which the ring of stage HM2 drives.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ..errors import InputError
from .mapping import Section
from .teeth import gear_ratio

MEMBERS = ("sun", "ring", "carrier")
CLOSED_SLIP = 0.01
"""Slip of a closed clutch up to which ratios count as consistent, relative to its faster side [-].

Chosen: ratios written with three digits differ by up to 0.5 % each.
"""

_SIDE = "[-]SHAFT[*PAIR or /PAIR ...]"


Stage = Any
"""`hmcvt_core.transmission.stage.Stage`, whose module imports this one."""
Path = Any
"""`hmcvt_core.transmission.stage.Path`."""


class ShaftSpeed(NamedTuple):
    """Speed of a shaft without slip of oil.

    Attributes:
        per_engine: per engine speed [-].
        per_output: per output speed [-].
    """

    per_engine: float
    per_output: float

    def times(self, factor: float) -> ShaftSpeed:
        """Return the speed of a shaft that turns `factor` times as fast."""
        # Adding zero makes a negative zero positive.
        return ShaftSpeed(
            factor * self.per_engine + 0.0, factor * self.per_output + 0.0
        )

    def minus(self, other: ShaftSpeed) -> ShaftSpeed:
        """Return the difference to another speed."""
        return ShaftSpeed(
            self.per_engine - other.per_engine, self.per_output - other.per_output
        )

    @property
    def size(self) -> float:
        """The larger coefficient, without sign [-]."""
        return max(abs(self.per_engine), abs(self.per_output))


_ENGINE = ShaftSpeed(1.0, 0.0)
_OUTPUT = ShaftSpeed(0.0, 1.0)
_HOUSING = ShaftSpeed(0.0, 0.0)


def open_clutches(
    file: Section, stage: Stage, stage_named: Callable[[str], Stage]
) -> tuple[tuple[str, float, float], ...]:
    """Return the clutches of a file that are open in a stage, with their slips.

    Args:
        file: with the section `clutches`, each `{between: [SIDE, SIDE], closed: [STAGE, ...]}`.
        stage: engaged.
        stage_named: returns another stage of the file.

    Returns:
        Name, slip per engine speed and slip per output speed of each [-].

    Raises:
        InputError: an entry is wrong, or a clutch that is closed in the stage would slip.
    """
    if "clutches" not in file.data:
        return ()
    section = file.section("clutches")
    slips = []
    for name in section.data:
        entry = section.section(name)
        slip, faster = _slip(file, entry, stage, stage_named)
        if stage.name not in _closed_in(entry, file):
            slips.append((str(name), slip.per_engine, slip.per_output))
            continue
        if slip.size > CLOSED_SLIP * faster:
            raise InputError(
                f"{entry.where}closed = {stage.name}: its sides differ there by "
                f"{slip.per_engine:.4g} x engine speed {slip.per_output:+.4g} x output speed; "
                "a closed clutch has none: check the two sides and their gear pairs"
            )
    return tuple(slips)


def _closed_in(entry: Section, file: Section) -> tuple[str, ...]:
    """Return the stages in which a clutch is closed."""
    closed = entry.data.get("closed", [])
    if not isinstance(closed, list):
        raise InputError(f"{entry.where}closed = {closed!r} is not a list of stages")
    stages = file.section("stages")
    for name in closed:
        stages.section(name)
    return tuple(str(name) for name in closed)


def _slip(
    file: Section,
    entry: Section,
    stage: Stage,
    stage_named: Callable[[str], Stage],
) -> tuple[ShaftSpeed, float]:
    """Return the difference of the two sides of a clutch, and the speed of the faster side."""
    place = f"{entry.where}between"
    between = entry.get("between")
    if not isinstance(between, list) or len(between) != 2:
        raise InputError(f"{place} = {between!r} is not allowed; allowed: two sides")
    first, second = (
        _side(file, str(side), place, stage, stage_named) for side in between
    )
    return first.minus(second), max(first.size, second.size)


def _side(
    file: Section,
    text: str,
    place: str,
    stage: Stage,
    stage_named: Callable[[str], Stage],
) -> ShaftSpeed:
    """Return the speed of one side of a clutch while a stage is engaged."""
    shaft, *gears = re.split(r"([*/])", text.replace(" ", ""))
    sense = -1.0 if shaft.startswith("-") else 1.0
    speed = _shaft(shaft.removeprefix("-"), place, stage, stage_named).times(sense)
    pairs = file.section("gear_pairs")
    for operation, pair in zip(gears[::2], gears[1::2], strict=True):
        if not pair:
            raise InputError(f"{place} = {text!r} is not allowed; allowed: {_SIDE}")
        ratio = gear_ratio(pairs.get(pair), f"{pairs.where}{pair}")
        speed = speed.times(1.0 / ratio if operation == "/" else ratio)
    return speed


def _shaft(
    name: str, place: str, stage: Stage, stage_named: Callable[[str], Stage]
) -> ShaftSpeed:
    """Return the speed of a shaft by its name."""
    simple = {"engine": _ENGINE, "output": _OUTPUT, "housing": _HOUSING}
    if name in simple:
        return simple[name]
    if name == "motor":
        return _motor(stage)
    owner, _, member = name.rpartition(".")
    if member not in MEMBERS:
        raise InputError(
            f"{place}: shaft {name!r} is not known; there is engine, motor, output, housing, "
            "and sun, ring, carrier of a row, also as STAGE.sun"
        )
    if owner in ("", stage.name):
        return _of_engaged_row(stage, place)[member]
    return _of_another_row(stage, stage_named(owner), place)[member]


def _motor(stage: Stage) -> ShaftSpeed:
    """Return the speed of the motor."""
    before = 0.0
    if stage.layout == "input_coupled":
        before = stage.mechanical_speed_ratio
    return ShaftSpeed(-before, 1.0).times(1.0 / stage.motor_speed_ratio)


def _of_engaged_row(stage: Stage, place: str) -> Mapping[str, ShaftSpeed]:
    """Return the speeds of the members of the row of the stage engaged."""
    if not stage.has_row:
        raise InputError(
            f"{place}: stage {stage.name} is hydrostatic and has no row; name the stage of "
            "the row, such as HM2.ring"
        )
    output = _OUTPUT.times(stage.output.direction * stage.output.ratio)
    return _with_third(
        stage,
        {
            stage.mechanical_member: _behind(stage.mechanical, _ENGINE),
            stage.output_member: output,
        },
    )


def _of_another_row(
    engaged: Stage, other: Stage, place: str
) -> Mapping[str, ShaftSpeed]:
    """Return the speeds of the members of the row of a stage that is not engaged."""
    if other.layout != "input_coupled":
        raise InputError(
            f"{place}: the row of {other.name} is {other.layout}; only the row of an "
            "input_coupled stage turns with engine and motor while it is not engaged"
        )
    return _with_third(
        other,
        {
            other.mechanical_member: _behind(other.mechanical, _ENGINE),
            other.motor_member: _behind(other.motor, _motor(engaged)),
        },
    )


def _behind(path: Path, speed: ShaftSpeed) -> ShaftSpeed:
    """Return the speed of the last shaft of a path."""
    return speed.times(path.direction / path.ratio)


def _with_third(
    stage: Stage, known: Mapping[str, ShaftSpeed]
) -> Mapping[str, ShaftSpeed]:
    """Return the speeds of all members of a row, the third by eq. (4)."""
    coefficients = stage.member_coefficients
    per_engine = 0.0
    per_output = 0.0
    for member, speed in known.items():
        per_engine += coefficients[member] * speed.per_engine
        per_output += coefficients[member] * speed.per_output
    (third,) = set(MEMBERS) - set(known)
    turned = ShaftSpeed(per_engine, per_output).times(-1.0 / coefficients[third])
    return {**known, third: turned}


def check_names(listed: Any, derived: Any, where: str) -> None:
    """Refuse a clutch that both `clutches` of the file and `open_clutches` of a stage state."""
    twice = {name for name, *_ in listed} & {name for name, *_ in derived}
    if twice:
        raise InputError(
            f"{where}open_clutches: {', '.join(sorted(twice))} is in clutches of the file too; "
            "state it once"
        )

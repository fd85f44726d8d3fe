# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A commented transmission file from gear ratios or tooth counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..errors import InputError
from .stage import PATHS

DIRECT = "direct"
"""Stands for a path without a gear pair."""

_SETTINGS = ("layout", "row", "reverse", *PATHS)
_CLUTCH_SETTINGS = ("between", "closed")


@dataclass(frozen=True)
class PathText:
    """One power path as a file states it.

    Attributes:
        gear_pairs: names of the pairs, in the order of the power; empty where a shaft connects
            the two ends directly.
        member: `sun`, `ring` or `carrier`; empty where the path does not end at the row.
        direction: 1, or -1 where the last shaft turns against the first.
    """

    gear_pairs: tuple[str, ...]
    member: str = ""
    direction: int = 1


@dataclass(frozen=True)
class StageText:
    """One stage as a file states it.

    Attributes:
        name: of the stage.
        layout: `input_coupled`, `output_coupled` or `hydrostatic`.
        row: name of the planetary row; empty without one.
        reverse: whether the mechanical path drives the output backward.
        paths: by name, see `PATHS`.
    """

    name: str
    layout: str
    row: str
    reverse: bool
    paths: Mapping[str, PathText]


def stage_from_text(text: str) -> StageText:
    """Read a stage written in one line.

    Args:
        text: name and settings, such as
            `HM4 row=k1 mechanical=2,3:carrier pump=4 motor=-5:sun output=6,11:ring`; a minus in
            front of the gear pairs reverses the path, and `direct` stands for no pair.

    Raises:
        InputError: a setting is unknown or incomplete.
    """
    name, settings = _settings("stage", text, _SETTINGS)
    paths = {}
    for path in PATHS:
        if path in settings:
            paths[path] = _path(settings[path])
    return StageText(
        name=name,
        layout=settings.get("layout", "input_coupled"),
        row=settings.get("row", ""),
        reverse=settings.get("reverse", "no") in ("yes", "true"),
        paths=paths,
    )


@dataclass(frozen=True)
class ClutchText:
    """One clutch as a file states it; `hmcvt_core.transmission.clutches` explains the sides.

    Attributes:
        name: of the clutch.
        between: its two sides.
        closed: stages in which it is closed.
    """

    name: str
    between: tuple[str, ...]
    closed: tuple[str, ...]


def clutch_from_text(text: str) -> ClutchText:
    """Read a clutch written in one line.

    Args:
        text: name and settings, such as `C2 between=HM2.ring/6/7,output*11 closed=HM2`.

    Raises:
        InputError: a setting is unknown or incomplete.
    """
    name, settings = _settings("clutch", text, _CLUTCH_SETTINGS)
    closed = [stage for stage in settings.get("closed", "").split(",") if stage]
    between = settings.get("between", "").split(",")
    if len(between) != 2 or not all(between):
        raise InputError(f"clutch {name}: write its two sides as between=SIDE,SIDE")
    return ClutchText(name, tuple(between), tuple(closed))


def _settings(kind: str, text: str, known: Sequence[str]) -> tuple[str, dict[str, str]]:
    """Return the first word of a line, and its further words `key=value`."""
    words = text.split()
    if not words or "=" in words[0]:
        raise InputError(f"{kind} {text!r}: the first word is the name of the {kind}")
    settings = {}
    for word in words[1:]:
        key, _, value = word.partition("=")
        if key not in known or not value:
            raise InputError(
                f"{kind} {words[0]}: {word!r} is not a setting; write one of "
                f"{', '.join(known)} as key=value"
            )
        settings[key] = value
    return words[0], settings


def _path(text: str) -> PathText:
    pairs, _, member = text.partition(":")
    direction = -1 if pairs.startswith("-") else 1
    names = [name for name in pairs.removeprefix("-").split(",") if name]
    if names == [DIRECT]:
        names = []
    return PathText(tuple(names), member, direction)


def commented_file(
    name: str,
    gear_pairs: Mapping[str, float | str],
    planetary_rows: Mapping[str, float | str],
    displacements: tuple[float, float],
    stages: Sequence[StageText],
    gear_efficiency: float = 0.98,
    clutches: Sequence[ClutchText] = (),
) -> str:
    """Return the text of a transmission file.

    Args:
        name: of the transmission.
        gear_pairs: ratio by name of the pair, driving speed / driven speed [-], or teeth as
            `DRIVEN/DRIVING`.
        planetary_rows: teeth of the ring / teeth of the sun by name of the row [-], or teeth as
            `RING/SUN`.
        displacements: of pump and motor [cm3/rev].
        stages: in the order of the file.
        gear_efficiency: of every pair [-].
        clutches: from which the slips of open clutches follow.
    """
    pump, motor = displacements
    lines = [
        "schema: hmcvt-transmission/1",
        f"name: {_quoted(name)}",
        "# Speed of the driving shaft / speed of the driven shaft, from engine to output, which is",
        "# teeth of the driven gear / teeth of the driving gear; 36/45 stands for 45 teeth that",
        "# drive 36.",
        f"gear_pairs: {_flow(gear_pairs)}",
        "# Of every pair; a mapping {pair: efficiency} sets each.",
        f"gear_efficiency: {gear_efficiency:g}",
        "# Teeth of the ring / teeth of the sun.",
        f"planetary_rows: {_flow(planetary_rows)}",
        "pump_motor:",
        f"  pump_displacement_cm3_per_rev: {pump:g}",
        f"  motor_displacement_cm3_per_rev: {motor:g}",
        "  # Friction torque / pressure torque, eqs (14) and (15); 0.01 is that of the paper.",
        "  pump_friction: 0.01",
        "  motor_friction: 0.01",
        "# Paths: mechanical, engine to row; pump, engine to pump; motor, motor to row; output,",
        "# row to output. Of layout output_coupled, pump is row to pump and motor is motor to",
        "# output; a hydrostatic stage has no row, and motor and output follow each other.",
        "# direction -1: the last shaft turns against the first.",
        "stages:",
    ]
    for stage in stages:
        lines += _stage_lines(stage)
    if clutches:
        lines += [
            "# Sides of each clutch: a shaft, then /PAIR behind a pair or *PAIR in front of it.",
            "clutches:",
        ]
    for clutch in clutches:
        between = ", ".join(map(_quoted, clutch.between))
        closed = ", ".join(map(_quoted, clutch.closed))
        lines.append(
            f"  {_quoted(clutch.name)}: {{between: [{between}], closed: [{closed}]}}"
        )
    return "\n".join(lines) + "\n"


def _stage_lines(stage: StageText) -> list[str]:
    lines = [f"  {_quoted(stage.name)}:"]
    if stage.layout != "input_coupled":
        lines.append(f"    layout: {stage.layout}")
    if stage.reverse:
        lines.append("    reverse: true")
    if stage.row:
        lines.append(f"    planetary_row: {_quoted(stage.row)}")
    for name, path in stage.paths.items():
        pairs = ", ".join(map(_quoted, path.gear_pairs))
        entry = f"gear_pairs: [{pairs}]"
        if path.member:
            entry += f", member: {path.member}"
        if path.direction != 1:
            entry += f", direction: {path.direction}"
        lines.append(f"    {name}: {{{entry}}}")
    return lines


def _flow(entries: Mapping[str, float | str]) -> str:
    cells = []
    for key, value in entries.items():
        written = value if isinstance(value, str) else f"{value:.10g}"
        cells.append(f"{_quoted(key)}: {written}")
    return f"{{{', '.join(cells)}}}"


def _quoted(text: str) -> str:
    """Return text as YAML reads it back: plain where it is a word, else in quotes."""
    if text.isalnum():
        return text
    escaped = text.replace("'", "''")
    return f"'{escaped}'"

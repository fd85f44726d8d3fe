# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Constants of stages as C text: numbers, strings, initialisers."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .constants import QuadrantFactors, RegimeFactors, StageFactors
from .effect_tables import EffectTable

_PLAIN_CHARACTERS = frozenset(
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _-+.:,()"
)


_CELLS = 8  # to a line of a table
_LINE = 100
"""Longest line of a row [characters]."""


def literal(value: float) -> str:
    """Return a number in the precision of the model; the digits give it back exactly."""
    return f"R({value!r})"


def numbers(values: Sequence[float]) -> str:
    """Return an initialiser of numbers."""
    return "{" + ", ".join(literal(value) for value in values) + "}"


def flag(value: bool) -> str:
    """Return a truth value."""
    return "true" if value else "false"


def string(text: str) -> str:
    """Return a string literal; what is not plain ASCII becomes octal bytes of UTF-8."""
    parts = []
    for character in text:
        if character in _PLAIN_CHARACTERS:
            parts.append(character)
        else:
            parts += [f"\\{byte:03o}" for byte in character.encode()]
    return '"' + "".join(parts) + '"'


def comment(text: str) -> str:
    """Return text that may stand in a comment."""
    return "".join(c if c in _PLAIN_CHARACTERS else "?" for c in text)


def stage_tables(
    stages: Sequence[StageFactors], effects: Sequence[EffectTable] = ()
) -> str:
    """Return the tables of all stages, with those of their effects."""
    blocks = []
    for number, stage in enumerate(stages):
        blocks.append(_stage_constants(number, stage))
    for number, table in enumerate(effects):
        blocks.append(_effect_constants(number, table))
    entries = []
    for number, stage in enumerate(stages):
        entries.append(_stage_entry(number, stage, bool(effects)))
    blocks.append(
        "static const stage_factors stages[HMCVT_STAGES] = {\n"
        + ",\n".join(entries)
        + "\n};\n"
    )
    return "\n".join(blocks)


def _stage_constants(number: int, stage: StageFactors) -> str:
    """Return the tables of regimes and quadrants of one stage."""
    count = len(stage.quadrants[0].regimes)
    regimes = []
    quadrants = []
    for position, quadrant in enumerate(stage.quadrants):
        where = f"{stage.name}, {quadrant.name}"
        for regime in quadrant.regimes:
            regimes.append(
                _named_row(f"{where}: {regime.name}", _regime_fields(regime))
            )
        fields = _quadrant_fields(quadrant)
        fields["regimes"] = f"&regimes_{number}[{position * count}]"
        quadrants.append(_named_row(where, fields))
    return (
        _stage_comment(stage)
        + f"static const regime_factors regimes_{number}[{len(regimes)}] = {{\n"
        + ",\n".join(regimes)
        + "\n};\n"
        f"static const quadrant_factors quadrants_{number}[{len(quadrants)}] = {{\n"
        + ",\n".join(quadrants)
        + "\n};\n"
    )


def _stage_comment(stage: StageFactors) -> str:
    """Return the name of a stage and its gear pairs as a comment."""
    lines = []
    for line in (stage.name, *stage.paths):
        lines += textwrap.wrap(comment(line), 94)
    return "/* " + "\n * ".join(lines) + " */\n"


def _named_row(name: str, fields: Mapping[str, str]) -> str:
    """Return an initialiser with its fields named, below its own name."""
    cells = [f".{field} = {value}" for field, value in fields.items()]
    row = textwrap.fill(
        "{" + ", ".join(cells) + "}",
        _LINE,
        initial_indent="    ",
        subsequent_indent="     ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return f"    /* {comment(name)} */\n{row}"


def _regime_fields(regime: RegimeFactors) -> dict[str, str]:
    return {
        "gear": literal(regime.gear),
        "transmitted": literal(regime.transmitted),
        "brace": literal(regime.brace),
        "pump": literal(regime.pump),
    }


def _quadrant_fields(quadrant: QuadrantFactors) -> dict[str, str]:
    return {
        "flow_ratio": literal(quadrant.flow_ratio),
        "rest": literal(quadrant.rest),
        "rest_squared": literal(quadrant.rest_squared),
        "sense": literal(quadrant.sense),
        "reflection": literal(quadrant.reflection),
        "output_share": literal(quadrant.output_share),
        "mechanical_load": literal(quadrant.mechanical_load),
    }


def _stage_entry(number: int, stage: StageFactors, has_effects: bool) -> str:
    fields = {
        "pump_on_row": flag(stage.pump_on_row),
        "reverse": flag(stage.reverse),
        "engine_share": literal(stage.engine_share),
        "output_share": literal(stage.output_share),
        "hydraulic_ratio": literal(stage.hydraulic_ratio),
        "displacement_squared": literal(stage.displacement_squared),
        "pump_friction": literal(stage.pump_friction),
        "gears": numbers(stage.gears),
        "backward_gears": numbers(stage.backward_gears),
        "rest_ratio": literal(stage.rest_ratio),
        "ratio_ends": numbers(stage.ratio_ends),
        "quadrants": f"quadrants_{number}",
    }
    if has_effects:
        fields["effects"] = f"&effects_{number}"
    return _named_row(stage.name, fields)


def _effect_constants(number: int, table: EffectTable) -> str:
    """Return what effects change in one stage."""
    blocks = []
    for axis, nodes in enumerate(table.axes):
        blocks.append(
            f"static const hmcvt_real effect_axis_{number}_{axis}[{nodes.size}] = {{\n"
            + _lines([literal(value) for value in nodes.tolist()])
            + "\n};\n"
        )
    for name, values in (("shift", table.shift), ("torque", table.torque)):
        blocks.append(
            f"static const float effect_{name}_{number}[{values.size}] = {{\n"
            + _lines(_floats(values))
            + "\n};\n"
        )
    axes = ", ".join(f"effect_axis_{number}_{axis}" for axis in range(3))
    counts = ", ".join(str(nodes.size) for nodes in table.axes)
    blocks.append(
        f"static const effect_table effects_{number} = {{{{{axes}}}, {{{counts}}},\n"
        f"    effect_shift_{number}, effect_torque_{number}}};\n"
    )
    return "".join(blocks)


def _floats(values: NDArray[np.float32]) -> list[str]:
    """Return single-precision literals; NAN where a table has no answer."""
    literals = []
    for value in values.ravel():
        # The shortest digits that give the number back in single precision.
        literals.append("NAN" if np.isnan(value) else f"{_digits(value)}f")
    return literals


def _digits(value: np.float32) -> str:
    return np.format_float_scientific(value, unique=True, trim="0")


def _lines(cells: Sequence[str]) -> str:
    """Return cells that commas separate, eight to a line."""
    lines = []
    for start in range(0, len(cells), _CELLS):
        lines.append("    " + ", ".join(cells[start : start + _CELLS]))
    return ",\n".join(lines)

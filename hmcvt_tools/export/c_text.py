# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Constants of stages as C text: numbers, strings, initialisers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .constants import QuadrantFactors, RegimeFactors, StageFactors
from .effect_tables import EffectTable

_PLAIN_CHARACTERS = frozenset(
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _-+.:,()"
)


_CELLS = 8  # to a line of a table


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
        for regime in quadrant.regimes:
            regimes.append(_regime_entry(regime))
        quadrants.append(_quadrant_entry(quadrant, number, position * count))
    return (
        f"/* {comment(stage.name)} */\n"
        f"static const regime_factors regimes_{number}[{len(regimes)}] = {{\n"
        + ",\n".join(regimes)
        + "\n};\n"
        f"static const quadrant_factors quadrants_{number}[{len(quadrants)}] = {{\n"
        + ",\n".join(quadrants)
        + "\n};\n"
    )


def _regime_entry(regime: RegimeFactors) -> str:
    values = (regime.gear, regime.transmitted, regime.brace, regime.pump)
    return f"    {numbers(values)}"


def _quadrant_entry(quadrant: QuadrantFactors, number: int, first_regime: int) -> str:
    values = (
        quadrant.flow_ratio,
        quadrant.rest,
        quadrant.rest_squared,
        quadrant.sense,
        quadrant.reflection,
        quadrant.output_share,
        quadrant.mechanical_load,
    )
    literals = ", ".join(literal(value) for value in values)
    return f"    {{{literals},\n     &regimes_{number}[{first_regime}]}}"


def _stage_entry(number: int, stage: StageFactors, has_effects: bool) -> str:
    fields = [
        flag(stage.pump_on_row),
        flag(stage.reverse),
        literal(stage.engine_share),
        literal(stage.output_share),
        literal(stage.hydraulic_ratio),
        literal(stage.displacement_squared),
        literal(stage.pump_friction),
        numbers(stage.gears),
        numbers(stage.backward_gears),
        literal(stage.rest_ratio),
        numbers(stage.ratio_ends),
        f"quadrants_{number}",
    ]
    if has_effects:
        fields.append(f"&effects_{number}")
    return "    {" + ",\n     ".join(fields) + "}"


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

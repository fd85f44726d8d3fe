# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Constants of stages as C text: numbers, strings, initialisers."""

from collections.abc import Sequence

from .constants import QuadrantFactors, RegimeFactors, StageFactors

_PLAIN_CHARACTERS = frozenset(
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _-+.:,()"
)


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


def stage_tables(stages: Sequence[StageFactors]) -> str:
    """Return the tables of all stages."""
    blocks = []
    for number, stage in enumerate(stages):
        blocks.append(_stage_constants(number, stage))
    entries = []
    for number, stage in enumerate(stages):
        entries.append(_stage_entry(number, stage))
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


def _stage_entry(number: int, stage: StageFactors) -> str:
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
    return "    {" + ",\n     ".join(fields) + "}"

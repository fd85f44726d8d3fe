# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers and names in words, whatever they belong to."""

import math
import textwrap
from collections.abc import Sequence

MINUS, AT_MOST = "\N{MINUS SIGN}", "\N{LESS-THAN OR EQUAL TO}"

NOTHING = "\N{EN DASH}"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_WIDTH = 100


def fixed(value: float | None, digits: int, sign: bool = False) -> str:
    """Return a number with so many decimals; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    value = round(value, digits) + 0.0  # no zero is negative
    return f"{value:{'+' if sign and value else ''}.{digits}f}".replace("-", MINUS)


def number(value: float | None) -> str:
    """Return a number with three significant digits, powers of ten as such."""
    if value is None or not math.isfinite(value):
        return NOTHING
    mantissa, _, power = f"{value:.3g}".partition("e")
    exponent = str(int(power)).translate(_SUPERSCRIPT) if power else ""
    times = f" \N{MULTIPLICATION SIGN} 10{exponent}" if power else ""
    return (mantissa + times).replace("-", MINUS)


def percent(value: float) -> str:
    """Return a part in percent."""
    return f"{fixed(100.0 * value, 0)} %"


def probability(value: float) -> str:
    """Return a probability in percent; none is quite 0 or 1."""
    if 0.0 < value < 0.01:
        return "< 1 %"
    return "> 99 %" if value > 0.99 else percent(value)


def chance(value: float | None) -> str:
    """Return a p-value; the simulated campaigns behind it tell none below a thousandth."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:.2g}" if value > 0.001 else f"{AT_MOST} 0.001"


def p_is(value: float) -> str:
    """Return `p = ...`, or that it is no larger than can be told."""
    told = chance(value)
    return f"p {told}" if told.startswith(AT_MOST) else f"p = {told}"


def plain(name: str) -> str:
    """Return the name of an effect or parameter in words."""
    return name.replace("_", " ")


def listed(names: Sequence[str], last: str = "or") -> str:
    """Return `a, b or c`."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def wrapped(line: str, margin: int = 0) -> str:
    """Return a line in lines of at most 100 characters, the further ones indented."""
    return textwrap.fill(
        line,
        _WIDTH,
        subsequent_indent=" " * margin,
        break_long_words=False,
        break_on_hyphens=False,
    )

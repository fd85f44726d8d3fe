# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Formatting of numbers, probabilities and names, for sentences and tables."""

import math
import textwrap
from collections.abc import Sequence

MINUS = "\N{MINUS SIGN}"
AT_MOST = "\N{LESS-THAN OR EQUAL TO}"
NOTHING = "\N{EN DASH}"
"""Stands for a value that does not exist."""

MIN_P_VALUE = 0.001
"""Smallest p value that the simulated campaigns resolve (`settings.DRAWS`)."""
SMALL_PROBABILITY = 0.01
"""Probabilities nearer to 0 or 1 than this are not printed exactly."""
LINE_WIDTH = 100

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def fixed(value: float | None, digits: int, sign: bool = False) -> str:
    """Return a number with a fixed number of decimals; a dash for None and NaN.

    Args:
        value: the number.
        digits: decimals.
        sign: whether to print a plus sign.
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    value = round(value, digits) + 0.0  # turns a negative zero into zero
    plus = "+" if sign and value else ""
    return f"{value:{plus}.{digits}f}".replace("-", MINUS)


def number(value: float | None) -> str:
    """Return a number with three significant digits; a dash for None and NaN."""
    if value is None or not math.isfinite(value):
        return NOTHING
    mantissa, _, power = f"{value:.3g}".partition("e")
    if power:
        exponent = str(int(power)).translate(_SUPERSCRIPT)
        mantissa += f" \N{MULTIPLICATION SIGN} 10{exponent}"
    return mantissa.replace("-", MINUS)


def percent(value: float) -> str:
    """Return a fraction in percent."""
    return f"{fixed(100.0 * value, 0)} %"


def probability(value: float) -> str:
    """Return a probability in percent; very small and very large ones as a bound."""
    if 0.0 < value < SMALL_PROBABILITY:
        return "< 1 %"
    if value > 1.0 - SMALL_PROBABILITY:
        return "> 99 %"
    return percent(value)


def chance(value: float | None) -> str:
    """Return a p value, or the bound that the simulated campaigns resolve."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value > MIN_P_VALUE:
        return f"{value:.2g}"
    return f"{AT_MOST} {MIN_P_VALUE:g}"


def p_is(value: float) -> str:
    """Return `p = ...`, or `p` with its bound."""
    text = chance(value)
    return f"p {text}" if text.startswith(AT_MOST) else f"p = {text}"


def plain(name: str) -> str:
    """Return the name of an effect or parameter in words."""
    return name.replace("_", " ")


def listed(names: Sequence[str], last: str = "or") -> str:
    """Return `a, b or c`.

    Args:
        names: the items.
        last: word before the last item.
    """
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def wrapped(line: str, margin: int = 0) -> str:
    """Return a line broken into lines of at most 100 characters.

    Args:
        line: the text.
        margin: indent of all lines but the first.
    """
    return textwrap.fill(
        line,
        LINE_WIDTH,
        subsequent_indent=" " * margin,
        break_long_words=False,
        break_on_hyphens=False,
    )

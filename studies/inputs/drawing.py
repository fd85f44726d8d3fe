# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Draw names, units and separators, and write tables with them.

Nothing of the readers of `hmcvt_core` and `hmcvt_tools` is used here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

RPM = np.pi / 30.0
GRAVITY = 9.81


class Spelling(NamedTuple):
    """How a unit may be written, and its size in SI.

    Attributes:
        text: in the header; `""` for none.
        size: SI value of one unit; `nan` for the angle of a slope in degrees.
        is_open: whether no reader can know what is meant.
    """

    text: str
    size: float
    is_open: bool = False


class Column(NamedTuple):
    """A column of a table.

    Attributes:
        header: cell of the header, with the unit.
        cells: of the rows.
    """

    header: str
    cells: list[str]


def choice(rng: np.random.Generator, options: Sequence[Any]) -> Any:
    """Return one of several options."""
    return options[int(rng.integers(len(options)))]


def headed(rng: np.random.Generator, name: str, unit: str) -> str:
    """Return a cell of the header."""
    if not unit:
        return name
    form = choice(rng, ("{} [{}]", "{} [{}]", "{} ({})", "{}[{}]"))
    return form.format(name, unit)


def write_table(
    rng: np.random.Generator, path: Path, columns: Sequence[Column]
) -> dict[str, str]:
    """Write columns; numbers in their cells have a decimal point.

    Returns:
        What was drawn.
    """
    separator = choice(rng, (",", ";", "\t"))
    decimal = "."
    if separator != "," and rng.random() < 0.4:
        decimal = ","
    order = rng.permutation(len(columns))
    lines = [separator.join(columns[place].header for place in order)]
    for row in range(len(columns[0].cells)):
        cells = [columns[place].cells[row] for place in order]
        lines.append(separator.join(cell.replace(".", decimal) for cell in cells))
    title = "# a comment above the header\n" if rng.random() < 0.2 else ""
    path.write_text(title + "\n".join(lines) + "\n", encoding="utf-8")
    return {"separator": separator, "decimal": decimal}


def texts(values: Any, digits: int = 5) -> list[str]:
    """Return numbers as cells."""
    return [f"{value:.{digits}f}" for value in np.asarray(values).tolist()]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Write the table of settings in docs/settings.md: `python docs/settings_table.py`."""

import ast
import itertools
import math
from pathlib import Path
from typing import Any

from hmcvt_core.diagnosis import settings

PAGE = Path(__file__).with_name("settings.md")
BEGIN = "<!-- settings: begin -->\n"
END = "<!-- settings: end -->\n"


def documented_settings() -> dict[str, str]:
    """Return the docstring of each setting by its name, in the order of the module."""
    body = ast.parse(Path(settings.__file__).read_text(encoding="utf-8")).body
    documented = {}
    for statement, following in itertools.pairwise(body):
        if not isinstance(statement, ast.Assign):
            continue
        name = ast.unparse(statement.targets[0])
        text = ""
        if isinstance(following, ast.Expr) and isinstance(
            following.value, ast.Constant
        ):
            text = str(following.value.value)
        documented[name] = text
    return documented


def table() -> str:
    """Return the table as Markdown."""
    lines = ["| setting | value | meaning | source |", "|---|---|---|---|"]
    for name, text in documented_settings().items():
        meaning, _, source = text.partition("Source: ")
        cells = [f"`{name}`", _value(getattr(settings, name)), meaning, source]
        lines.append("| " + " | ".join(" ".join(cell.split()) for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def page(text: str) -> str:
    """Return the text of the page with the present table."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


def _value(value: Any) -> str:
    """Return a setting as a reader writes it, with four significant digits."""
    if isinstance(value, tuple):
        return ", ".join(_value(item) for item in value)
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_value(item)}" for key, item in value.items())
    if isinstance(value, float) and not math.isclose(value, float(f"{value:.4g}")):
        return f"about {value:.4g}"
    return f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

# SPDX-License-Identifier: Apache-2.0
"""Pages from templates: everything that a template prints is escaped, and nothing is loaded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .style import COLOURS, check_drawable

_TEMPLATES = Path(__file__).parent / "templates"


def render(template: str, folder: Path = _TEMPLATES, /, **context: Any) -> str:
    """Return a page.

    Args:
        template: its name; it may extend `base.html.j2` and include what stands beside that.
        folder: where it lies.
        context: what it names. `Markup` and SVG of `style.to_svg` go in as they are.

    Raises:
        InputError: Jinja2 or matplotlib is missing.
    """
    check_drawable()
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, _TEMPLATES]), autoescape=True, undefined=StrictUndefined,
        finalize=_printable, extensions=["jinja2.ext.do"], trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True)
    return environment.get_template(template).render(colours=COLOURS, **context)


def _printable(value: Any) -> Any:
    """Replace what no page may hold, such as control characters in the name of a file."""
    if not isinstance(value, str) or hasattr(value, "__html__"):
        return value
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}"
                   for letter in value)

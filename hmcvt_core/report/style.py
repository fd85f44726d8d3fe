# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How everything drawn looks, on pages and in files: letters, colours, SVG, templates.

Readable in grey and on a projector: large letters, dark lines, and marks or hatches wherever colour
tells things apart.
"""

import importlib.util
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..errors import InputError

FORMATS = (".png", ".svg", ".html")
PANEL = (6.9, 5.0)
"""Size of a figure among others on a page [in]: its letters stay readable on a phone."""

BLUE, ORANGE, INK, SOFT = "#1f5f99", "#b3480a", "#1b1f24", "#57606a"
COLOURS = {"blue": BLUE, "orange": ORANGE, "ink": INK, "soft": SOFT, "rule": "#d5dae0"}

# Fill and hatch of every loss, in the order of the stack.
LOSSES: Mapping[str, tuple[str, str]] = {
    "gear pairs": ("#3d444c", ""),
    "planetary row": ("#9aa3ad", "xx"),
    "pump damping": ("#8db9de", ""),
    "motor damping": ("#2c6ca5", ""),
    "pump friction": ("#ffffff", "--"),
    "motor friction": ("#dfe4e9", "||"),
    "leakage": ("#ecd9a6", ""),
    "pressure drop": ("#bfd8c2", "++"),
    "charge pump": ("#f3a56a", "//"),
    "clutch drag": ("#e0825a", "xx"),
    "bearing drag": ("#f7c9a3", "\\\\"),
    "churning": ("#d9734a", "||"),
    "output churning": ("#fbe0c8", "||"),
}

_SVG, _LINK = "http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"
_ICON = 20.0 / 72.0
TEMPLATES = Path(__file__).parent / "templates"
_LENGTHS, _NUMBER = frozenset(("d", "x", "y")), re.compile(r"-?\d+\.\d{3,}")


def check_drawable() -> None:
    """Check that what draws is installed, without importing it.

    Raises:
        InputError: it is not.
    """
    for name in ("jinja2", "matplotlib"):
        if importlib.util.find_spec(name) is None:
            raise InputError(
                f"pages and pictures need {name}; in the folder of hmcvt: "
                'pip install ".[report]"'
            )


def picture_format(path: str) -> str:
    """Return the ending of a picture's file.

    Raises:
        InputError: the ending names none of `FORMATS`, or what draws is missing.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise InputError(f"{path}: a picture ends in {', '.join(FORMATS)}")
    check_drawable()
    return ending


@contextmanager
def styled(size: tuple[float, float] = PANEL) -> Iterator[Any]:
    """Give an empty matplotlib figure, to be drawn and written inside the context.

    Raises:
        InputError: matplotlib is missing.
    """
    check_drawable()
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(
        {"text.color": INK, "axes.labelcolor": INK}, TEMPLATES / "pictures.mplstyle"
    ):
        yield Figure(figsize=size)


def loss_style(part: str) -> dict[str, Any]:
    """Return how an area that shows a loss is filled."""
    fill, hatch = LOSSES.get(part, ("#f3a56a", "++"))
    return {"facecolor": fill, "hatch": hatch, "edgecolor": INK, "linewidth": 0.6}


def few_ticks(axes: Any) -> None:
    """Keep the numbers of the axes apart at the size of a phone."""
    axes.locator_params(nbins=6, steps=(1, 2, 5, 10))


def to_png(figure: Any, dpi: int = 130) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def to_svg(
    figure: Any,
    name: str,
    title: str = "",
    tips: Mapping[str, str | Sequence[str]] = MappingProxyType({}),
) -> str:
    """Return a figure as an `svg` element for a page, with names that no other figure has.

    Args:
        figure: as drawn.
        name: its id, and the beginning of all others in it.
        title: read out; a figure without is left out when a page is read out.
        tips: what shows over an artist with that `gid`: one text, or one for each of its marks.
    """
    buffer = io.StringIO()
    figure.savefig(
        buffer,
        format="svg",
        metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")),
    )
    # Verdana has the same widths where DejaVu is not installed.
    text = buffer.getvalue().replace(
        "'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif"
    )
    root = ET.fromstring(re.sub(r' id="|href="#|url\(#', rf"\g<0>{name}-", text))
    for item in root.iter():
        for key in _LENGTHS.intersection(item.keys()):
            item.set(
                key,
                _NUMBER.sub(lambda found: f"{float(found[0]):.2f}", item.attrib[key]),
            )
    for item in root.iter(f"{{{_SVG}}}g"):
        if texts := tips.get(item.get("id", "").removeprefix(f"{name}-")):
            _tip(item, texts)
    root.set("id", name)
    if title:
        root.set("role", "img")
        root.set("aria-labelledby", f"{name}-title")
        heading = ET.Element(f"{{{_SVG}}}title", id=f"{name}-title")
        heading.text = title
        root.insert(0, heading)
    else:
        root.set("aria-hidden", "true")
    ET.register_namespace("", _SVG)
    ET.register_namespace("xlink", _LINK)
    return re.sub(r"\s*\n\s*", " ", ET.tostring(root, encoding="unicode"))


def _tip(group: ET.Element, texts: str | Sequence[str]) -> None:
    """Let a group show one text, or each of its marks its own."""
    marks = [
        mark
        for part in group
        if part.tag != f"{{{_SVG}}}defs"
        for mark in part.iter()
        if mark.tag in (f"{{{_SVG}}}use", f"{{{_SVG}}}path")
    ]
    if isinstance(texts, str):
        marks, texts = [group], [texts]
    for mark, text in zip(marks, texts, strict=True):
        title = ET.Element(f"{{{_SVG}}}title")
        title.text = text
        mark.insert(0, title)
        if mark is not group:
            mark.set("data-test", text.partition(":")[0])


def icon(name: str, draw: Callable[[Any], None]) -> str:
    """Return a mark for a legend of the page; `draw` takes axes from 0 to 1."""
    with styled((_ICON, _ICON)) as figure:
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.set_axis_off()
        draw(axes)
        return to_svg(figure, name)


def render(template: str, folder: Path = TEMPLATES, /, **context: Any) -> str:
    """Return a page; everything that a template prints is escaped, and nothing is loaded.

    Args:
        template: its name; it may extend `base.html.j2` and include what stands beside that.
        folder: where it lies.
        context: what it names. `Markup` and SVG of `to_svg` go in as they are.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([folder, TEMPLATES]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable,
        extensions=["jinja2.ext.do"],
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(colours=COLOURS, **context)


def _printable(value: Any) -> Any:
    """Replace what no page may hold, such as control characters in the name of a file."""
    if not isinstance(value, str) or hasattr(value, "__html__"):
        return value
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}"
        for letter in value
    )

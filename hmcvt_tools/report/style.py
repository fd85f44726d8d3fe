# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How everything drawn looks, on pages and in files: letters, colours, SVG, templates.

Pictures stay readable in grey and on a projector: large letters, dark lines, and marks or hatches
wherever colour distinguishes things.
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

from hmcvt_core.errors import InputError

FORMATS = (".png", ".svg", ".pdf", ".html")
"""Endings of files with a picture."""

REPORT_FORMATS = (".html", ".pdf")
"""Endings of files with the report of a diagnosis."""

PANEL = (6.9, 5.0)
"""Size of a figure among others on a page [in]: its letters stay readable on a phone."""

BLUE = "#1f5f99"
ORANGE = "#b3480a"
INK = "#1b1f24"
SOFT = "#57606a"
COLOURS = {"blue": BLUE, "orange": ORANGE, "ink": INK, "soft": SOFT, "rule": "#d5dae0"}

EFFICIENCY_COLOURS = "viridis"
"""Colour map of every picture of an efficiency: perceptually even, and even in grey."""

GAP_COLOURS = ("#e08a4e", "#f3c9a8", "#ffffff", "#aecbe4", "#5a97c9")
"""Colours of an estimated gap, from bench below model over none to bench above model."""

DEVIATION_COLOURS = ("#ffffff", "#e6e0ee", "#b9abd0", "#8f7cb0")
"""Colours of a standard deviation, from none to the largest; even in grey."""

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
    "fan drive": ("#e8b48c", "oo"),
    "clutch slip": ("#c9622f", "//"),
    "brake drag": ("#f0c2a0", "xx"),
}

_SVG = "http://www.w3.org/2000/svg"
_LINK = "http://www.w3.org/1999/xlink"
_ICON_SIZE = 20.0 / 72.0  # in
TEMPLATES = Path(__file__).parent / "templates"
_LENGTHS = frozenset(("d", "x", "y"))
_LONG_NUMBER = re.compile(r"-?\d+\.\d{3,}")


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


def report_format(path: str) -> str:
    """Return the ending of a report's file.

    Raises:
        InputError: the ending names none of `REPORT_FORMATS`, or what draws is missing.
    """
    ending = Path(path).suffix.lower()
    if ending not in REPORT_FORMATS:
        raise InputError(f"{path}: a report ends in {', '.join(REPORT_FORMATS)}")
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
    """Set few ticks, so that their numbers stay apart at the size of a phone."""
    axes.locator_params(nbins=6, steps=(1, 2, 5, 10))


def to_png(figure: Any, dpi: int = 130) -> bytes:
    """Return a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def to_pdf(figure: Any) -> bytes:
    """Return a figure as PDF, the same from the same input."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="pdf", metadata={"CreationDate": None})
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
    # Every name and every reference to one begins with the name of the figure.
    root = ET.fromstring(re.sub(r' id="|href="#|url\(#', rf"\g<0>{name}-", text))
    _shorten_numbers(root)
    for item in root.iter(f"{{{_SVG}}}g"):
        texts = tips.get(item.get("id", "").removeprefix(f"{name}-"))
        if texts:
            _add_tips(item, texts)
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


def _shorten_numbers(root: ET.Element) -> None:
    """Round lengths to a hundredth of a point, which halves the size of a page."""
    for item in root.iter():
        for key in _LENGTHS.intersection(item.keys()):
            item.set(key, _LONG_NUMBER.sub(_two_decimals, item.attrib[key]))


def _two_decimals(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2f}"


def _add_tips(group: ET.Element, texts: str | Sequence[str]) -> None:
    """Add a tooltip to a group, or one to each of its marks."""
    if isinstance(texts, str):
        _add_title(group, texts)
        return
    for mark, text in zip(_marks(group), texts, strict=True):
        _add_title(mark, text)
        mark.set("data-test", text.partition(":")[0])


def _add_title(item: ET.Element, text: str) -> None:
    title = ET.Element(f"{{{_SVG}}}title")
    title.text = text
    item.insert(0, title)


def _marks(group: ET.Element) -> list[ET.Element]:
    """Return the marks of a scatter plot, without their definitions."""
    marks = []
    for part in group:
        if part.tag == f"{{{_SVG}}}defs":
            continue
        for item in part.iter():
            if item.tag in (f"{{{_SVG}}}use", f"{{{_SVG}}}path"):
                marks.append(item)
    return marks


def icon(name: str, draw: Callable[[Any], None]) -> str:
    """Return a mark for a legend of the page; `draw` takes axes from 0 to 1."""
    with styled((_ICON_SIZE, _ICON_SIZE)) as figure:
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        axes.set_axis_off()
        draw(axes)
        return to_svg(figure, name)


def render(template: str, folder: Path = TEMPLATES, /, **context: Any) -> str:
    """Return a page; everything that a template prints is escaped, and nothing is loaded.

    Args:
        template: its name; it may extend `base.html.j2` and include the files next to that.
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
    letters = []
    for letter in value:
        letters.append(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}")
    return "".join(letters)

# SPDX-License-Identifier: Apache-2.0
"""Small pure functions that draw SVG; lengths are in user units of the drawing."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...diagnosis.words import MINUS

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def text(value: object) -> str:
    """Return a value as text that is safe in markup; what cannot be printed becomes a mark."""
    plain = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}"
                    for letter in str(value))
    return html.escape(plain, quote=True)


def element(name: str, *content: str, **attributes: object) -> str:
    """Return one element; `content` is markup, attribute names lose a trailing underscore."""
    head = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_attribute(value)}"'
        for key, value in attributes.items() if value is not None)
    return f"<{name}{head}>{''.join(content)}</{name}>"


def _attribute(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.2f}".rstrip("0").rstrip(".")
    return text(value)


def drawing(identity: str, title: str, width: float, height: float, *content: str) -> str:
    """Return an `svg` that scales with its container and is read out by its title."""
    return element("svg", element("title", text(title), id=f"{identity}-title"), *content,
                   id=identity, viewBox=f"0 0 {width:g} {height:g}", role="img",
                   aria_labelledby=f"{identity}-title")


@dataclass(frozen=True)
class Scale:
    """A linear axis: values `low`..`high` on lengths `start`..`end`."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: float) -> float:
        """Place a value."""
        return self.start + (value - self.low) / (self.high - self.low) * (self.end - self.start)

    def ticks(self, most: int = 6) -> list[float]:
        """Return round values inside the axis, at most `most` + 1."""
        step = self.step(most)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        return [i * step for i in range(first, last + 1)]

    def step(self, most: int = 6) -> float:
        """Return the distance of ticks."""
        rough = (self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(rough))
        return next(step * power for step in _STEPS if step * power >= rough * (1.0 - 1e-9))

    def names(self, most: int = 6) -> list[str]:
        """Return the text of each tick, with no more digits than their distance needs."""
        step = self.step(most)
        digits = next(d for d in range(12) if abs(step * 10**d - round(step * 10**d)) < 1e-6)
        return [f"{value:.{digits}f}".replace("-", MINUS) for value in self.ticks(most)]


def padded(values: Sequence[float], start: float, end: float, part: float = 0.06) -> Scale:
    """Return an axis that holds all values with some room; a single value gets room too."""
    low, high = min(values), max(values)
    room = part * (high - low) or 0.05 * abs(high) or 1.0
    return Scale(low - room, high + room, start, end)


@dataclass(frozen=True)
class Panel:
    """A plotting area: two axes; `y.start` is its lower edge."""

    x: Scale
    y: Scale

    def frame(self) -> str:
        """Return the border."""
        return element("rect", class_="frame", x=self.x.start, y=self.y.end,
                       width=self.x.end - self.x.start, height=self.y.start - self.y.end)

    def inside(self, x: float, y: float) -> bool:
        """Tell whether a point of values lies in the area."""
        return self.x.low <= x <= self.x.high and self.y.low <= y <= self.y.high


def x_axis(panel: Panel, label: str, most: int = 6) -> str:
    """Return ticks, grid lines and label of the lower axis."""
    parts = []
    for value, name in zip(panel.x.ticks(most), panel.x.names(most), strict=True):
        at = panel.x(value)
        parts.append(_line(at, panel.y.start, at, panel.y.end, "grid"))
        parts.append(element("text", text(name), x=at, y=panel.y.start + 21.0,
                             text_anchor="middle"))
    middle = (panel.x.start + panel.x.end) / 2.0
    parts.append(element("text", text(label), class_="label", x=middle, y=panel.y.start + 41.0,
                         text_anchor="middle"))
    return "".join(parts)


def y_axis(panel: Panel, label: str, at: float, most: int = 6) -> str:
    """Return ticks, grid lines and label of the left axis; the label stands at `at`."""
    parts = []
    for value, name in zip(panel.y.ticks(most), panel.y.names(most), strict=True):
        height = panel.y(value)
        parts.append(_line(panel.x.start, height, panel.x.end, height, "grid"))
        parts.append(element("text", text(name), x=panel.x.start - 7.0, y=height + 4.5,
                             text_anchor="end"))
    return "".join(parts) + _upright(label, at, (panel.y.start + panel.y.end) / 2.0)


def right_axis(panel: Panel, factor: float, label: str, at: float, most: int = 6) -> str:
    """Return ticks and label of a right axis that shows `factor` times the values of the left."""
    scale = Scale(panel.y.low * factor, panel.y.high * factor, panel.y.start, panel.y.end)
    parts = []
    for value, name in zip(scale.ticks(most), scale.names(most), strict=True):
        height = scale(value)
        parts.append(_line(panel.x.end, height, panel.x.end + 5.0, height, "tick"))
        parts.append(element("text", text(name), x=panel.x.end + 8.0, y=height + 4.5))
    return "".join(parts) + _upright(label, at, (panel.y.start + panel.y.end) / 2.0)


def _upright(label: str, x: float, y: float) -> str:
    return element("text", text(label), class_="label", text_anchor="middle",
                   transform=f"translate({x:g} {y:g}) rotate(-90)")


def _line(x1: float, y1: float, x2: float, y2: float, kind: str) -> str:
    return element("line", class_=kind, x1=x1, y1=y1, x2=x2, y2=y2)


def level(panel: Panel, value: float, kind: str = "zero") -> str:
    """Return a horizontal line over the whole panel."""
    return _line(panel.x.start, panel.y(value), panel.x.end, panel.y(value), kind)


def triangle(x: float, y: float, size: float, up: bool, kind: str, title: str = "") -> str:
    """Return a triangle about (x, y); `size` is half its height."""
    tip, foot = (y - size, y + size) if up else (y + size, y - size)
    corners = f"{x:.1f},{tip:.1f} {x - size:.1f},{foot:.1f} {x + size:.1f},{foot:.1f}"
    return element("polygon", _tip(title), class_=kind, points=corners)


def dot(x: float, y: float, size: float, kind: str, title: str = "") -> str:
    """Return a circle."""
    return element("circle", _tip(title), class_=kind, cx=x, cy=y, r=size)


def legend(entries: Sequence[tuple[str, str]]) -> str:
    """Return a list of marks; each entry is its text and its drawing in a box of 20 by 20."""
    return element("ul", *(element(
        "li", element("svg", icon, viewBox="0 0 20 20", class_="icon", aria_hidden="true",
                      width=20, height=20), text(label)) for label, icon in entries),
        class_="legend")


def _tip(title: str) -> str:
    return element("title", text(title)) if title else ""

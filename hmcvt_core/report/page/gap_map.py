# SPDX-License-Identifier: Apache-2.0
"""Where the gap lies: residuals over the working space, three views of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import words
from ...diagnosis.result import REGION_SIGNIFICANCE, Diagnosis, Region
from ...model.model import EfficiencyModel
from ...transmission.ranges import RPM
from . import svg
from .svg import Panel, Scale

Array = NDArray[np.float64]

WIDTH, HEIGHT = 460.0, 400.0
_LABELS = {"displacement_ratio": "displacement ratio [-]", "engine_speed": "engine speed [r/min]",
           "load_torque": "load torque [N·m]"}
_UNITS = {"displacement_ratio": 1.0, "engine_speed": 1.0 / RPM, "load_torque": 1.0}
_VIEWS = (("displacement_ratio", "engine_speed"), ("displacement_ratio", "load_torque"),
          ("engine_speed", "load_torque"))
_MOST_MARKS = 400
_CELLS = 18  # cells along an axis when there are more samples than marks
_SMALL, _LARGE = 3.0, 9.0  # half height of a triangle
_FLAG = 18.0  # side of the flag with the number of a place
_TOP_QUANTILE = 0.98


class Residuals(NamedTuple):
    """What the map shows.

    Attributes:
        values: measured - predicted, shape (n,) [-]; NaN where the model has no answer.
        note: how they came about, in words.
    """

    values: Array
    note: str


class _Mark(NamedTuple):
    x: float
    y: float
    value: float
    noise: float
    title: str


def residuals(found: Diagnosis) -> Residuals:
    """Return the residuals of the refitted base model at the samples diagnosed."""
    left_out = found.residuals_before
    if found.shrinkage.on == "cross-validation" and len(left_out) == len(found.samples):
        return Residuals(left_out, "predicted without the sample itself")
    # A part that all samples share is booked as calibration of the meters, as in the diagnosis.
    offset = shared(found, found.base)
    return Residuals(_errors(found, found.base) - offset,
                     f"less the part that all samples share, {words.points(offset, sign=True)}")


def shared(found: Diagnosis, model: EfficiencyModel) -> float:
    """Return the mean of measured - predicted over the samples diagnosed [-]."""
    errors = _errors(found, model)
    known = errors[np.isfinite(errors)]
    return float(np.mean(known)) if len(known) else 0.0


def _errors(found: Diagnosis, model: EfficiencyModel) -> Array:
    samples = found.samples
    return np.asarray(samples.efficiency - model.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque,
        samples.oil_temperature))


def maps(found: Diagnosis) -> list[str]:
    """Return one drawing for each pair of axes."""
    values = residuals(found).values
    largest = _largest(found, values)
    return [_view(found, values, largest, horizontal, vertical, i)
            for i, (horizontal, vertical) in enumerate(_VIEWS)]


def condensed(found: Diagnosis) -> bool:
    """Whether marks are means over cells, there being too many samples."""
    return len(found.samples) > _MOST_MARKS


def legend(found: Diagnosis) -> str:
    """Return what the marks mean."""
    noise = found.gap.noise
    middle = words.points(_largest(found, residuals(found).values) / 2.0)
    entries = [
        ("bench below model", svg.triangle(10.0, 10.0, 7.0, False, "below")),
        ("bench above model", svg.triangle(10.0, 10.0, 7.0, True, "above")),
        ("less than twice the noise", svg.triangle(10.0, 10.0, 7.0, False, "below pale")),
        (f"within the noise ({words.points(noise)})", svg.dot(10.0, 10.0, 2.5, "within")),
        (f"this size: {middle}",
         svg.triangle(10.0, 10.0, (_SMALL + _LARGE) / 2.0, False, "below")),
    ]
    if found.where:
        entries.append(("numbered places of the table below", svg.element(
            "rect", class_="region", x=3.0, y=3.0, width=14.0, height=14.0)))
    return svg.legend(entries)


def _largest(found: Diagnosis, values: Array) -> float:
    sizes = np.abs(values[np.isfinite(values)])
    top = float(np.quantile(sizes, _TOP_QUANTILE)) if len(sizes) else 0.0
    return max(top, 2.0 * found.gap.noise, 1e-9)


def _view(found: Diagnosis, values: Array, largest: float, horizontal: str, vertical: str,
          index: int) -> str:
    across, up = (np.asarray(getattr(found.samples, axis)) * _UNITS[axis]
                  for axis in (horizontal, vertical))
    speeds = vertical == "engine_speed"
    panel = Panel(svg.padded(across.tolist(), 66.0, WIDTH - (62.0 if speeds else 16.0)),
                  svg.padded(up.tolist(), HEIGHT - 52.0, 14.0))
    marks = _marks(found, values, across, up)
    # Large marks first, so that small ones stay visible.
    marks.sort(key=lambda mark: -abs(mark.value))
    parts = [svg.x_axis(panel, _LABELS[horizontal]), svg.y_axis(panel, _LABELS[vertical], 16.0)]
    if speeds:
        parts.append(svg.right_axis(panel, RPM, "engine speed [rad/s]", WIDTH - 6.0))
    parts.append(panel.frame())
    parts += [_draw(panel, mark, largest) for mark in marks]
    parts += _boxes(found, panel, horizontal, vertical,
                    [(panel.x(mark.x), panel.y(mark.y)) for mark in marks])
    title = (f"Map of residuals: {_LABELS[vertical]} over {_LABELS[horizontal]}; "
             "triangles down where the bench lies below the model, up where above")
    return svg.drawing(f"map-{index}", title, WIDTH, HEIGHT, *parts)


def _draw(panel: Panel, mark: _Mark, largest: float) -> str:
    x, y, size = panel.x(mark.x), panel.y(mark.y), abs(mark.value)
    if size <= mark.noise:
        return svg.dot(x, y, 2.5, "within", mark.title)
    half = _SMALL + (_LARGE - _SMALL) * min(size / largest, 1.0)
    kind = "above" if mark.value > 0.0 else "below"
    if size <= 2.0 * mark.noise:
        kind += " pale"
    return svg.triangle(x, y, half, mark.value > 0.0, kind, mark.title)


def _marks(found: Diagnosis, values: Array, across: Array, up: Array) -> list[_Mark]:
    known = np.flatnonzero(np.isfinite(values))
    if condensed(found):
        return _cell_means(found, values[known], across[known], up[known])
    samples = found.samples
    return [_Mark(float(across[i]), float(up[i]), float(values[i]), found.gap.noise,
                  "displacement ratio "
                  f"{words.fixed(float(samples.displacement_ratio[i]), 2)}, "
                  f"{words.rpm(float(samples.engine_speed[i]))} r/min, "
                  f"{words.fixed(float(samples.load_torque[i]), 0)} N·m: "
                  f"{words.points(float(values[i]), sign=True)}") for i in known]


def _cell_means(found: Diagnosis, values: Array, across: Array, up: Array) -> list[_Mark]:
    cell = np.zeros(len(values), dtype=int)
    for axis in (across, up):
        span = max(float(np.ptp(axis)), 1e-12)
        place = np.minimum((axis - axis.min()) / span * _CELLS, _CELLS - 1).astype(int)
        cell = cell * _CELLS + place
    _, group, count = np.unique(cell, return_inverse=True, return_counts=True)
    means = [np.bincount(group, column) / count for column in (across, up, values)]
    return [_Mark(float(x), float(y), float(value), found.gap.noise / float(np.sqrt(n)),
                  f"mean of {n} samples: {words.points(float(value), sign=True)}")
            for x, y, value, n in zip(*means, count.tolist(), strict=True)]


def _boxes(
    found: Diagnosis, panel: Panel, horizontal: str, vertical: str,
    marks: list[tuple[float, float]],
) -> list[str]:
    parts: list[str] = []
    flags: list[tuple[float, float]] = []
    for number, region in enumerate(found.where, 1):
        box = _box(panel, region, horizontal, vertical)
        if box is None:
            continue
        left, top, right, bottom = box
        kind = "region" if region.p_value <= REGION_SIGNIFICANCE else "region weak"
        parts.append(svg.element("rect", class_=kind, x=left, y=top, width=right - left,
                                 height=bottom - top))
        x, y = _corner(panel, box, flags, marks)
        flags.append((x, y))
        parts.append(svg.element("rect", class_="flag", x=x, y=y, width=_FLAG, height=_FLAG))
        parts.append(svg.element("text", str(number), class_="flag-text", x=x + _FLAG / 2.0,
                                 y=y + 13.5, text_anchor="middle"))
    return parts


def _corner(
    panel: Panel, box: tuple[float, float, float, float], flags: list[tuple[float, float]],
    marks: list[tuple[float, float]],
) -> tuple[float, float]:
    """Place of a flag at the edge of a box, hiding no other flag and fewest marks."""
    left, top, right, bottom = box
    across = np.linspace(left, max(right - _FLAG, left), 9).tolist()
    down = np.linspace(top, max(bottom - _FLAG, top), 9).tolist()
    places = [*((x, down[0]) for x in across), *((across[0], y) for y in down[1:]),
              *((across[-1], y) for y in down[1:]), *((x, down[-1]) for x in across[1:-1]),
              (left, top - _FLAG), (right, top), (left - _FLAG, top), (left, bottom),
              (right, bottom - _FLAG), (left - _FLAG, bottom - _FLAG)]
    places = [(x, y) for x, y in places if panel.x.start <= x <= panel.x.end - _FLAG
              and panel.y.end <= y <= panel.y.start - _FLAG] or places[:1]

    def hidden(place: tuple[float, float]) -> tuple[int, int]:
        x, y = place
        return (sum(abs(x - other) < _FLAG + 1.0 and abs(y - height) < _FLAG + 1.0
                    for other, height in flags),
                sum(-7.0 < mark - x < _FLAG + 7.0 and -7.0 < height - y < _FLAG + 7.0
                    for mark, height in marks))

    return min(places, key=hidden)


def _box(
    panel: Panel, region: Region, horizontal: str, vertical: str
) -> tuple[float, float, float, float] | None:
    """Edges of a region in a view, or None where it spans the whole view and says nothing."""
    ends = []
    for axis, scale in ((horizontal, panel.x), (vertical, panel.y)):
        low, high = (end * _UNITS[axis] for end in getattr(region, axis))
        ends.append((low, high, _spans(scale, low, high)))
    if ends[0][2] and ends[1][2]:
        return None
    left, right = (panel.x(end) for end in ends[0][:2])
    bottom, top = (panel.y(end) for end in ends[1][:2])
    room = 9.0  # a mark at the edge belongs to the place
    across = np.clip([left - room, right + room], panel.x.start + 1.0, panel.x.end - 1.0)
    down = np.clip([top - room, bottom + room], panel.y.end + 1.0, panel.y.start - 1.0)
    return float(across[0]), float(down[0]), float(across[1]), float(down[1])


def _spans(scale: Scale, low: float, high: float) -> bool:
    return (high - low) > 0.86 * (scale.high - scale.low)

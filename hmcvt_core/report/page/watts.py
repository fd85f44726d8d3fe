# SPDX-License-Identifier: Apache-2.0
"""Where the watts go, before and after the effect is added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import words
from ...diagnosis.result import Diagnosis
from ...model.model import EfficiencyModel
from . import svg
from .svg import Panel, Scale

Array = NDArray[np.float64]

WIDTH, HEIGHT = 460.0, 340.0
_BARS = 7
_PARTS = {
    "pump_damping": "pump damping", "motor_damping": "motor damping",
    "pump_friction": "friction under pressure", "motor_friction": "friction under pressure",
    "leakage": "leakage", "planetary_row": "planetary row", "pressure_drop": "pressure drop",
}
_ORDER = ("gear pairs", "planetary row", "pump damping", "motor damping",
          "friction under pressure", "leakage", "pressure drop")
_LEAST = 1e-3  # part of the total loss below which a part is not drawn


class Watts(NamedTuple):
    """Losses at one speed and load over the displacement ratio.

    Attributes:
        displacement_ratio: shape (k,) [-].
        engine_speed, load_torque: [rad/s], [N m].
        before, after: watts by part, each shape (k,), NaN where the model has no answer.
    """

    displacement_ratio: Array
    engine_speed: float
    load_torque: float
    before: Mapping[str, Array]
    after: Mapping[str, Array]

    @property
    def parts(self) -> list[str]:
        """Names of the parts that take anything worth drawing, in order of the stack."""
        names = [*_ORDER, *(name for name in self.after if name not in _ORDER),
                 *(name for name in self.before if name not in _ORDER)]
        most = max(self._most(name) for name in names)
        return [name for name in dict.fromkeys(names)
                if self._most(name) > _LEAST * most or (most == 0.0 and name in self.before)]

    def _most(self, name: str) -> float:
        both = np.concatenate([np.atleast_1d(losses.get(name, np.zeros(1)))
                               for losses in (self.before, self.after)])
        known = np.abs(both[np.isfinite(both)])
        return float(known.max()) if len(known) else 0.0


def watts(found: Diagnosis) -> Watts:
    """Break the losses of both models down at the median speed, load and oil temperature."""
    samples = found.samples
    low, high = samples.displacement_ratio.min(), samples.displacement_ratio.max()
    strokes = np.linspace(low, high, _BARS) if high > low else np.array([low])
    speed, load = float(np.median(samples.engine_speed)), float(np.median(samples.load_torque))
    heat = (None if samples.oil_temperature is None
            else float(np.median(samples.oil_temperature)))
    before, after = (_losses(model, strokes, speed, load, heat)
                     for model in (found.base, found.model))
    return Watts(strokes, speed, load, before, after)


def _losses(
    model: EfficiencyModel, strokes: Array, speed: float, load: float, heat: float | None
) -> dict[str, Array]:
    grouped: dict[str, Array] = {}
    for name, loss in model.breakdown(strokes, speed, load, heat).losses.items():
        part = "gear pairs" if name.startswith("gear_pair_") else _PARTS.get(
            name, words.plain(name))
        grouped[part] = grouped.get(part, np.zeros(len(strokes))) + np.broadcast_to(
            loss, strokes.shape)
    # What turns idly loses something known even where the load cannot be carried: drop it.
    unanswered = np.isnan(sum(grouped.values()))
    return {part: np.where(unanswered, np.nan, loss) for part, loss in grouped.items()}


def drawings(found: Diagnosis, shares: Watts) -> list[str]:
    """Return stacked bars before and, if an effect was added, after."""
    panels = [("Base model, refitted", shares.before)]
    if found.model is not found.base:
        panels.append(("With the effect added", shares.after))
    highest, lowest = 0.0, 0.0
    for _, losses in panels:
        stack = np.nan_to_num(np.stack([losses[part] for part in shares.parts if part in losses]))
        highest = max(highest, float(np.maximum(stack, 0.0).sum(axis=0).max()))
        lowest = min(lowest, float(np.minimum(stack, 0.0).sum(axis=0).min()))
    top = highest if highest > lowest else 1e3
    y = Scale(1.05 * lowest / 1e3, 1.05 * top / 1e3, HEIGHT - 52.0, 34.0)
    return [_panel(shares, title, losses, y, i) for i, (title, losses) in enumerate(panels)]


def _panel(shares: Watts, title: str, losses: Mapping[str, Array], y: Scale, index: int) -> str:
    strokes = shares.displacement_ratio
    step = float(strokes[1] - strokes[0]) if len(strokes) > 1 else 0.5
    panel = Panel(Scale(float(strokes[0]) - 0.6 * step, float(strokes[-1]) + 0.6 * step, 66.0,
                        WIDTH - 16.0), y)
    bars = [_bar(panel, losses, shares.parts, i, panel.x(float(strokes[i])),
                 0.7 * step * (panel.x(1.0) - panel.x(0.0))) for i in range(len(strokes))]
    heading = svg.element("text", svg.text(title), class_="heading", x=panel.x.start, y=20.0)
    return svg.drawing(
        f"watts-{index}", f"{title}: power lost in each part over displacement ratio",
        WIDTH, HEIGHT, heading, svg.x_axis(panel, "displacement ratio [-]"),
        svg.y_axis(panel, "power lost [kW]", 16.0), panel.frame(), *bars, svg.level(panel, 0.0))


def _bar(
    panel: Panel, losses: Mapping[str, Array], parts: list[str], index: int, middle: float,
    width: float,
) -> str:
    if not all(np.isfinite(loss[index]) for loss in losses.values()):
        return svg.element("text", "no answer", class_="label",
                           transform=f"translate({middle + 4:.1f} {panel.y.start - 8:.1f}) "
                                     "rotate(-90)")
    up, down, drawn = 0.0, 0.0, []
    for place, part in enumerate(parts):
        if part not in losses:
            continue
        kilowatts = float(losses[part][index]) / 1e3
        start = up if kilowatts >= 0.0 else down
        end = start + kilowatts
        up, down = max(up, end), min(down, end)
        top, bottom = panel.y(max(start, end)), panel.y(min(start, end))
        drawn.append(svg.element(
            "rect", svg.element("title", svg.text(f"{part}: {words.fixed(kilowatts, 2)} kW")),
            class_=f"part {_kind(part, place)}", x=middle - width / 2.0, y=top, width=width,
            height=bottom - top))
    return "".join(drawn)


def _kind(part: str, place: int) -> str:
    """Class of a part: one grey value or pattern each, the effect in the strongest."""
    return f"part-{_ORDER.index(part)}" if part in _ORDER else f"part-new-{place % 2}"


def legend(shares: Watts) -> str:
    """Return the parts, the topmost of the stack first."""
    entries = [(part, svg.element("rect", class_=f"part {_kind(part, place)}", x=1, y=1, width=18,
                                  height=18)) for place, part in enumerate(shares.parts)]
    return svg.legend(entries[::-1])


def means(shares: Watts) -> list[tuple[str, float, float]]:
    """Return part, mean watts before and mean watts after; the total comes last.

    Means are over the bars that both models answer; NaN if there is none.
    """
    both = (shares.before, shares.after)
    answered = np.all([np.isfinite(loss) for losses in both for loss in losses.values()], axis=0)

    def mean(loss: Array) -> float:
        return float(loss[answered].mean()) if answered.any() else float("nan")

    nothing = np.zeros(len(shares.displacement_ratio))
    rows = []
    for part in shares.parts:
        before, after = (mean(losses.get(part, nothing)) for losses in both)
        rows.append((part, before, after))
    rows.append(("total", sum(row[1] for row in rows), sum(row[2] for row in rows)))
    return rows

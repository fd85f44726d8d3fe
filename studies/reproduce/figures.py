# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Figures 3 to 6, in the style of the pictures of hmcvt (extra `report`)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.colors import BoundaryNorm
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.report.style import BLUE, ORANGE, styled, to_png, to_svg

from .algorithms import COOLER, GA, IMPROVED_SA, NEAR, PSO, SERVED, STANDARD_SA, WITHOUT
from .comparison import Summary
from .procedure import Reproduction
from .surfaces import Surface

_LEVELS = (0, 20, 40, 50, 60, 65, 70, 75, 80, 83, 90, 100)  # %, of figures 3 to 5
# Told apart by line and mark as well, so that a grey print says the same.
_OURS, _PAPER = BLUE, ORANGE
_BOX = {"color": "0.85", "edgecolor": "black"}
_EACH = {"ls": "none", "marker": "o", "mfc": "none", "mec": BLUE, "ms": 5}
_NAMES = {"published": "published formulas", "power_balance": "power balance"}


@dataclass(frozen=True)
class Drawing:
    """One figure.

    Attributes:
        name: of its files, without ending.
        title: read out, and above it.
        caption: what it shows, in sentences.
        svg, png: the figure.
    """

    name: str
    title: str
    caption: str
    svg: str
    png: bytes


def drawings(found: Reproduction) -> list[Drawing]:
    """Draw every figure of the report, in its order."""
    return [*map(_surface_drawing, found.surfaces), *_figure6(found)]


def _drawn(name: str, title: str, caption: str, draw: Callable[[Any], None]) -> Drawing:
    with styled() as figure:
        draw(figure.subplots())
        return Drawing(
            name, title, caption, to_svg(figure, name, title), to_png(figure, dpi=110)
        )


# --- figures 3 to 5 -------------------------------------------------------------------------------


def _surface_drawing(surface: Surface) -> Drawing:
    name = f"figure{surface.figure}-{surface.formulation.replace('_', '-')}"
    title = (
        f"Figure {surface.figure}: {1e-3 * surface.load_power:g} kW, "
        f"{_NAMES[surface.formulation]}"
    )
    caption = (
        "Efficiency over engine speed and transmission ratio n_out / n_e, eq. (5)."
    )
    if surface.formulation == "published":
        caption += (
            " Hatched: the formulas contradict themselves. Thick line: a pole of (11), "
            "where eta_total leaves to both infinities."
        )
    elif surface.refused:
        caption += " Hatched: the load cannot be carried, leakage takes the whole flow."
    return _drawn(name, title, caption, lambda axes: _surface(axes, surface))


def _surface(axes: Any, surface: Surface) -> None:
    speed, ratio = surface.engine_speed / RPM, surface.speed_ratio
    served = 100.0 * surface.efficiency
    axes.grid(visible=False)
    axes.contourf(
        speed,
        ratio,
        np.isnan(served).astype(float),
        levels=[0.5, 1.5],
        colors="none",
        hatches=["////"],
    )
    shades = axes.contourf(
        speed,
        ratio,
        served,
        levels=_LEVELS,
        cmap="gray",
        norm=BoundaryNorm(_LEVELS, 256),
    )
    axes.contour(speed, ratio, served, levels=_LEVELS, colors="black", linewidths=0.7)
    axes.figure.colorbar(shades, ax=axes, label="efficiency [%]", ticks=_LEVELS)
    if surface.denominator is not None:
        axes.contour(
            speed,
            ratio,
            surface.denominator,
            levels=[0.0],
            colors=_PAPER,
            linewidths=4.0,
        )
    axes.set(xlabel="engine speed [r/min]", ylabel="transmission ratio n_out / n_e [-]")


# --- figure 6 and the ablation --------------------------------------------------------------------

_FIRST = 10  # evaluations at which the curves begin to be drawn


def _figure6(found: Reproduction) -> list[Drawing]:
    seeds = f"{found.seeds} seeds"
    first = [IMPROVED_SA, COOLER, STANDARD_SA, GA, PSO]
    target = f"Dashed: {100 * (NEAR - 1):.0f} % above the lowest."
    return [
        _drawn(
            "figure6-evolution",
            "Figure 6: evolution over evaluations",
            f"Lowest 1 - RSQ so far above the lowest known, {found.lowest:.5f}; median of "
            f"{seeds}, band: quartiles; part 1 of the improved SA is not counted. {target}",
            lambda axes: _evolution(axes, found, first),
        ),
        _drawn(
            "figure6-errors",
            "Figure 6: error reached",
            f"1 - RSQ above the lowest known (at least 1e-6); box: quartiles, bar: median, "
            f"circles: all {seeds}. {target}",
            lambda axes: _boxes(axes, found, [*first, SERVED]),
        ),
        _drawn(
            "ablation",
            "The four improvements, each left out",
            f"As the figure before; the same {seeds}. {target}",
            lambda axes: _boxes(
                axes, found, [IMPROVED_SA, *WITHOUT.values(), STANDARD_SA]
            ),
        ),
    ]


def _above(found: Reproduction, values: Any) -> Any:
    """Excess over the lowest value known, with a floor that a logarithm can show."""
    return np.maximum(np.asarray(values) - found.lowest, 1e-6)


def _evolution(axes: Any, found: Reproduction, names: Sequence[str]) -> None:
    styles = {
        IMPROVED_SA: (_OURS, "-"),
        COOLER: (_OURS, (0, (1, 1))),
        STANDARD_SA: ("0.5", "--"),
        GA: (_PAPER, "-."),
        PSO: ("black", ":"),
    }
    for name in names:
        summary, (color, line) = found.summaries[name], styles[name]
        last = int(summary.quartiles("evaluations")[1])
        grid = np.unique(np.geomspace(_FIRST, last, 200).astype(int))
        curves = np.array([_curve(run.curve, grid) for run in summary.runs])
        low, middle, high = (
            _above(found, q) for q in np.percentile(curves, (25, 50, 75), axis=0)
        )
        axes.fill_between(grid, low, high, color=color, alpha=0.16, lw=0)
        axes.plot(grid, middle, color=color, ls=line, lw=2.6, label=name)
        axes.plot(grid[-1], middle[-1], color=color, marker="o", ms=8)
    axes.axhline((NEAR - 1.0) * found.lowest, color="0.3", ls=(0, (6, 4)), lw=1.2)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="evaluations [-]",
        ylabel="1 - RSQ above the lowest [-]",
    )
    axes.set_ylim(7e-7, 3.0)
    axes.set_xlim(_FIRST, None)
    _plain_powers(axes.xaxis, axes.yaxis)
    axes.legend(loc="lower left")


def _curve(curve: Sequence[tuple[int, float]], grid: Any) -> Any:
    """Lowest value so far at evaluation counts; 1 (as bad as the mean) before the first answer."""
    counts = np.array([count for count, _ in curve])
    values = np.array([1.0, *(value for _, value in curve)])
    return np.minimum(values[np.searchsorted(counts, grid, side="right")], 1.0)


def _boxes(axes: Any, found: Reproduction, names: Sequence[str]) -> None:
    names = list(reversed(names))
    values = [
        _above(found, [run.value for run in found.summaries[name].runs])
        for name in names
    ]
    for place, row in enumerate(values, 1):
        low, middle, high = np.percentile(row, (25, 50, 75))
        axes.barh(place, high - low, left=low, height=0.6, **_BOX)
        axes.plot((middle, middle), (place - 0.3, place + 0.3), color="black", lw=3.0)
        axes.plot(row, place + np.linspace(-0.2, 0.2, len(row)), **_EACH)
    axes.axvline((NEAR - 1.0) * found.lowest, color="0.3", ls=(0, (6, 4)), lw=1.2)
    axes.set(
        xscale="log",
        xlabel="1 - RSQ above the lowest [-]",
        yticks=range(1, len(names) + 1),
        yticklabels=[_two_lines(name, found.summaries[name]) for name in names],
    )
    axes.set_xlim(6e-7, 3.0)
    _plain_powers(axes.xaxis)


def _plain_powers(*scales: Any) -> None:
    """Write 1e-6, not a small raised exponent; every second power has room."""
    for scale in scales:
        scale.set_major_locator(LogLocator(numticks=5))
        scale.set_major_formatter(
            FuncFormatter(lambda value, _: f"{value:g}".replace("e-0", "e-"))
        )
        scale.set_minor_locator(NullLocator())


def _two_lines(name: str, summary: Summary) -> str:
    for long, short in (
        ("without ", "no "),
        ("shrinking ", ""),
        ("adaptive ", ""),
        (" start", ""),
    ):
        name = name.replace(long, short)
    return f"{name}\n{summary.quartiles('evaluations')[1]:.0f} evaluations"

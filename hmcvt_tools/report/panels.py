# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of a watch and of what a plan can distinguish."""

from typing import Any

import numpy as np

from hmcvt_core.diagnosis import Isolability
from hmcvt_core.diagnosis.settings import DECISIVE_SQUARED_DEVIATIONS
from hmcvt_core.diagnosis.wording import plain
from hmcvt_core.monitoring import Opening

from .style import BLUE, INK, ORANGE, few_ticks

MEAN_SAMPLES = 20
"""Samples of the running mean of a watch."""


def draw_opening(figure: Any, opening: Opening, ax: Any = None) -> None:
    """Draw the residuals that a watch compared, and the gap since it opened.

    Args:
        figure: empty matplotlib figure.
        opening: result of a watch.
        ax: axes to draw into instead.
    """
    axes = figure.subplots() if ax is None else ax
    axes.axhline(0.0, color=INK, lw=1.0)
    trace = opening.trace
    if trace is not None and len(trace.sample):
        band = 200.0 * trace.deviations
        axes.fill_between(
            trace.sample, -band, band, color="#e9edf1", lw=0.0, label="twice the noise"
        )
        axes.scatter(
            trace.sample, 100.0 * trace.residuals, s=14.0, color=BLUE, alpha=0.6
        )
        if len(trace.sample) >= MEAN_SAMPLES:
            window = np.ones(MEAN_SAMPLES) / MEAN_SAMPLES
            mean = np.convolve(trace.residuals, window, "valid")
            last_of_window = trace.sample[MEAN_SAMPLES - 1 :]
            axes.plot(
                last_of_window, 100.0 * mean, color=INK, lw=2.0, label="running mean"
            )
    title = "No gap has opened"
    if opening.open and opening.since is not None and opening.size is not None:
        axes.axvline(opening.since, color=ORANGE, lw=2.0)
        size = 100.0 * opening.size
        axes.plot(
            (opening.since, opening.samples),
            (size, size),
            color=ORANGE,
            lw=2.5,
            label="gap since it opened",
        )
        title = f"A gap of {size:+.2f} points since sample {opening.since}"
    axes.set(
        title=title,
        xlabel="sample",
        ylabel="measured minus predicted efficiency [points]",
    )
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="best")
    few_ticks(axes)


def draw_separation(figure: Any, isolability: Isolability, ax: Any = None) -> None:
    """Draw how far each effect (row) stays visible when another one (column) may mimic it.

    Args:
        figure: empty matplotlib figure.
        isolability: of a plan.
        ax: axes to draw into instead.
    """
    axes = figure.subplots() if ax is None else ax
    deviations = np.sqrt(isolability.separation)
    limit = np.sqrt(DECISIVE_SQUARED_DEVIATIONS)
    image = axes.imshow(deviations, cmap="cividis", vmin=0.0, vmax=2.0 * limit)
    names = [plain(name) for name in isolability.effects]
    places = range(len(names))
    axes.grid(visible=False)
    axes.set_xticks(places, names, rotation=90, fontsize=9)
    axes.set_yticks(places, names, fontsize=9)
    for row in places:
        for column in places:
            if deviations[row, column] < limit:
                axes.text(
                    column,
                    row,
                    "\N{MULTIPLICATION SIGN}",
                    color="w",
                    ha="center",
                    va="center",
                )
    axes.set(
        title=f"Deviations that separate effects; \N{MULTIPLICATION SIGN}: fewer than {limit:g}",
        xlabel="may be mimicked by",
        ylabel="effect at its typical size",
    )
    bar = axes.figure.colorbar(image, ax=axes, extend="max")
    bar.set_label("standard deviations")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Files and notebook figures that hold a picture, and the picture of a fit."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.identification import Identification
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY
from hmcvt_core.transmission.ranges import Array

from .losses import draw_losses
from .style import BLUE, ORANGE, picture_format, render, styled, to_pdf, to_png, to_svg
from .surface import draw_surface

__all__ = ["draw_fit", "draw_losses", "draw_surface", "drawn", "save"]

SIZE = (10.0, 6.4)
"""Size of a picture in a file [in]."""

_NOTEBOOK_DPI = 80
_FIT_SIZE = (7.6, 8.2)  # in; square axes, and the legend below
_MARKERS = "o^Dvs<P>X"
_MARKERS_HELD_BACK = "s"
_BAND = 0.02  # part of the measured efficiency that the grey band shows


def save(draw: Callable[..., None], path: str | os.PathLike[str], *shown: Any) -> None:
    """Draw on an empty matplotlib figure and write it, whole or not at all.

    Args:
        draw: takes the figure, and what is shown.
        path: ends in one of `FORMATS`; an HTML page holds the picture in itself.
        shown: passed on to `draw`.

    Raises:
        InputError: see `picture_format`.
        OSError: the file cannot be written.
    """
    ending = picture_format(os.fspath(path))
    content: str | bytes
    with styled(SIZE) as figure:
        draw(figure, *shown)
        if ending == ".png":
            content = to_png(figure)
        elif ending == ".pdf":
            content = to_pdf(figure)
        else:
            title = _title(figure)
            content = to_svg(figure, "picture", title)
            if ending == ".html":
                content = render("picture.html.j2", title=title, picture=content)
    write_atomically(Path(path), content)


def _title(figure: Any) -> str:
    """Return the title of the whole figure, or else of its first axes."""
    title = figure.get_suptitle() or figure.axes[0].get_title(loc="left")
    return str(title).splitlines()[0]


def drawn(
    draw: Callable[..., None], *shown: Any, ax: Any = None, **options: Any
) -> Any:
    """Return a matplotlib figure that a notebook shows.

    Args:
        draw: takes an empty figure, what is shown, and the axes as `ax` where there are some.
        shown: what is shown.
        ax: matplotlib Axes to draw into; None makes a figure.
        options: of `draw`.
    """
    if ax is not None:
        draw(ax.figure, *shown, ax=ax, **options)
        return ax.figure
    with styled(SIZE) as figure:
        draw(figure, *shown, **options)
    figure._repr_png_ = lambda: to_png(figure, _NOTEBOOK_DPI)
    return figure


def draw_fit(
    figure: Any,
    fit: Identification,
    held_back: BenchSamples | None = None,
    ax: Any = None,
) -> None:
    """Draw measured over predicted efficiency, both with their uncertainty.

    Args:
        figure: empty matplotlib figure.
        fit: the identification.
        held_back: samples that the identification did not see.
        ax: axes to draw into instead.
    """
    if ax is None:
        figure.set_size_inches(*_FIT_SIZE)
        ax = figure.subplots()
    drawn = _draw_samples(ax, fit, fit.samples, "fitted", _MARKERS, BLUE)
    if held_back is not None:
        markers = _MARKERS if len(fit.stages) > 1 else _MARKERS_HELD_BACK
        drawn += _draw_samples(ax, fit, held_back, "held out", markers, ORANGE)
    efficiencies = np.concatenate(drawn)
    low = np.nanmin(efficiencies)
    high = np.nanmax(efficiencies)
    margin = max(0.15 * (high - low), 0.01)
    line = 100.0 * np.array([low - margin, high + margin])
    ax.plot(line, line, color="0.35", lw=1.4, zorder=0)
    ax.fill_between(
        line,
        line * (1.0 - _BAND),
        line * (1.0 + _BAND),
        color="0.9",
        lw=0,
        zorder=-1,
        label=f"{100.0 * _BAND:g} % of measured",
    )
    errors = f"mean error {100.0 * fit.fit_error:.2f} % fitted"
    if fit.prediction_error is not None:
        errors += f", {100.0 * fit.prediction_error:.2f} % held out"
    if fit.set_aside:
        errors += f"; not drawn: {len(fit.set_aside)} rejected"
    ax.set(
        xlim=line,
        ylim=line,
        aspect="equal",
        xlabel="predicted efficiency [%]",
        ylabel="measured efficiency [%]",
        title=f"Measured against predicted, {_stages(fit)}\n{errors}",
    )
    ax.legend(loc="upper left")


def _stages(fit: Identification) -> str:
    """Return in words which stages the samples are of."""
    noun = "stage" if len(fit.stages) == 1 else "stages"
    return f"{noun} {', '.join(fit.stages)}"


def _draw_samples(
    axes: Any,
    fit: Identification,
    samples: BenchSamples,
    name: str,
    markers: str,
    colour: str,
) -> list[Array]:
    """Draw samples with error bars, each stage with a marker.

    Args:
        axes: matplotlib Axes.
        fit: its model predicts.
        samples: of one stage, or with the stage of each.
        name: of the samples in the legend.
        markers: of the stages, in the order of the file; used again from the first on.
        colour: of the samples.

    Returns:
        Predicted and measured efficiencies.
    """
    names = samples.points.stage
    if names is None or len(fit.stages) == 1:
        return [_draw_group(axes, fit.model, samples, name, markers[0], colour)]
    drawn = []
    for number, stage in enumerate(fit.model.stages):
        of_stage = np.asarray(names) == stage
        if of_stage.any():
            group = samples.select(of_stage)
            marker = markers[number % len(markers)]
            label = f"{name}, {stage}"
            drawn.append(_draw_group(axes, fit.model, group, label, marker, colour))
    return drawn


def _draw_group(
    axes: Any,
    model: EfficiencyModel,
    samples: BenchSamples,
    name: str,
    marker: str,
    colour: str,
) -> Array:
    """Draw samples with one marker; return their predicted and measured efficiencies."""
    prediction = model.predict(*samples.points)
    deviation = samples.efficiency_std
    if deviation is None:
        deviation = PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency
    axes.errorbar(
        100.0 * prediction.efficiency,
        100.0 * samples.efficiency,
        xerr=100.0 * np.nan_to_num(prediction.standard_error),
        yerr=100.0 * deviation,
        fmt=marker,
        ms=10,
        color=colour,
        capsize=4,
        lw=1.6,
        label=f"{name} ({len(samples)})",
    )
    return np.concatenate([prediction.efficiency, samples.efficiency])

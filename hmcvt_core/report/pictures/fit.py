# SPDX-License-Identifier: Apache-2.0
"""Measured against predicted efficiency, with the uncertainty of both."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...files.bench import BenchSamples
from ...identification import Identification
from ...transmission.uncertainty import PAPER_EFFICIENCY_UNCERTAINTY


def draw_fit(figure: Any, found: Identification, held_back: BenchSamples | None = None) -> None:
    """Draw measured over predicted efficiency on a matplotlib figure.

    Args:
        figure: empty.
        found: the identification.
        held_back: samples that it did not see.
    """
    figure.set_size_inches(7.6, 8.2)
    axes = figure.subplots()
    sets = [("fitted", found.samples, "o", "#0b5394")]
    if held_back is not None:
        sets.append(("held back", held_back, "s", "#b45f06"))
    ends = [np.inf, -np.inf]
    for name, samples, marker, colour in sets:
        predicted = found.model.predict(samples.displacement_ratio, samples.engine_speed,
                                        samples.load_torque, samples.oil_temperature)
        deviation = _deviation(samples)
        axes.errorbar(
            100.0 * predicted.efficiency, 100.0 * samples.efficiency,
            xerr=100.0 * np.nan_to_num(predicted.standard_error), yerr=100.0 * deviation,
            fmt=marker, ms=10, color=colour, capsize=4, lw=1.6, label=f"{name} ({len(samples)})")
        both = np.concatenate([predicted.efficiency, samples.efficiency])
        ends = [min(ends[0], np.nanmin(both)), max(ends[1], np.nanmax(both))]
    margin = max(0.15 * (ends[1] - ends[0]), 0.01)
    line = 100.0 * np.array([ends[0] - margin, ends[1] + margin])
    axes.plot(line, line, color="0.35", lw=1.4, zorder=0)
    axes.fill_between(line, line * 0.98, line * 1.02, color="0.9", zorder=-1,
                      label="2 % of measured")
    axes.set(xlim=line, ylim=line, xlabel="predicted efficiency [%]",
             ylabel="measured efficiency [%]")
    axes.set_aspect("equal")
    held = "" if found.prediction_error is None else (
        f", {100.0 * found.prediction_error:.2f} % held back")
    axes.set_title(f"Measured against predicted\nmean error {100.0 * found.fit_error:.2f} % "
                   f"fitted{held}")
    axes.legend(loc="upper left", frameon=False)


def _deviation(samples: BenchSamples) -> Any:
    if samples.efficiency_std is not None:
        return samples.efficiency_std
    return PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency

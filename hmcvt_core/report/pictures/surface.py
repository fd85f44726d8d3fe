# SPDX-License-Identifier: Apache-2.0
"""Efficiency over engine speed and transmission ratio, with the best points and the bench."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...files.bench import BenchSamples
from ...model.domain import Domain
from ...model.model import EfficiencyModel
from ...transmission.ranges import ENGINE_SPEED_LIMITS, LOAD_TORQUE, RPM

Array = NDArray[np.float64]
_STROKES, _SPEEDS, _BEST = 161, 121, 60
_LEVELS = np.array([30, 40, 50, 60, 65, 70, 75, 80, 85, 90, 95])


def draw_surface(
    figure: Any,
    model: EfficiencyModel,
    power: float,
    engine_speeds: tuple[float, float] = ENGINE_SPEED_LIMITS,
    samples: BenchSamples | None = None,
) -> None:
    """Draw the efficiency at a load power on a matplotlib figure.

    Args:
        figure: empty.
        model: to draw.
        power: output power [W].
        engine_speeds: lowest and highest [rad/s].
        samples: bench tests to mark, each with measured - predicted in points.
    """
    axes = figure.subplots()
    stroke, speed = np.meshgrid(np.linspace(-1.0, 1.0, _STROKES),
                                np.linspace(*engine_speeds, _SPEEDS), indexing="ij")
    torque = np.clip(power / speed, LOAD_TORQUE.low, LOAD_TORQUE.high)
    served = model.without_meters()
    efficiency = 100.0 * served.efficiency(stroke, speed, torque)
    ratio = served.output_speed(stroke, speed, torque) / speed
    # A stalled point has no output speed to be drawn at; it stays blank where it would be.
    at = np.where(np.isnan(ratio), _tight_ratio(model, stroke), ratio)
    filled = axes.contourf(speed / RPM, at, np.ma.masked_invalid(efficiency), levels=_LEVELS,
                           cmap="Greys_r", extend="min", alpha=0.75)
    lines = axes.contour(speed / RPM, at, np.ma.masked_invalid(efficiency), levels=_LEVELS,
                         colors="0.15", linewidths=0.9)
    axes.clabel(lines, fmt="%g %%", fontsize=12)
    if model.formulation == "power_balance":  # the other has no optimum to draw
        _draw_best(axes, model, power, engine_speeds, at)
    if model.domain is not None:
        _draw_domain(axes, served, model.domain, power, engine_speeds)
    if samples is not None:
        _draw_samples(axes, model, samples)
    axes.set(xlabel="engine speed [r/min]", ylabel="output speed / engine speed [-]")
    axes.set_title(f"Efficiency at {1e-3 * power:g} kW")
    axes.grid(False)
    figure.colorbar(filled, ax=axes, label="efficiency [%]", pad=0.02)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)


def _tight_ratio(model: EfficiencyModel, stroke: Array) -> Array:
    from ...transmission.stage import speed_ratio

    return speed_ratio(model.stage, stroke)


def _draw_best(
    axes: Any, model: EfficiencyModel, power: float, limits: tuple[float, float], ratio: Array
) -> None:
    speed = np.linspace(*limits, _BEST)
    best = model.optimal_displacement_ratio(speed, power / speed)
    axes.plot(speed / RPM, best.output_speed / speed, color="#0b5394", lw=2.6, ls="--",
              label="best at an engine speed")
    target = np.linspace(np.nanmin(ratio) * limits[0], np.nanmax(ratio) * limits[1], 2 * _BEST)
    pair = model.optimal_displacement_ratio(
        speed[0], power / speed[0], hold="output_speed", output_speed=target,
        engine_speed_limits=limits)
    axes.plot(pair.engine_speed / RPM, target / pair.engine_speed, color="#b45f06", lw=3.0,
              label="best at an output speed")


def _draw_domain(
    axes: Any, model: EfficiencyModel, domain: Domain, power: float, limits: tuple[float, float]
) -> None:
    """Outline how far the data of the identification reach at this power, if they do."""
    low = max(domain.engine_speed[0], power / domain.load_torque[1], limits[0])
    high = min(domain.engine_speed[1], power / domain.load_torque[0], limits[1])
    if low > high:
        axes.plot([], [], " ", label="no data at this power")
        return
    speed = np.linspace(low, high, _BEST)
    torque = power / speed
    ends = [model.output_speed(stroke, speed, torque) / speed
            for stroke in domain.displacement_ratio]
    axes.plot(np.concatenate([speed, speed[::-1], speed[:1]]) / RPM,
              np.concatenate([ends[0], ends[1][::-1], ends[0][:1]]), color="0.1", lw=2.2, ls=":",
              label="data of the identification")


def _draw_samples(axes: Any, model: EfficiencyModel, samples: BenchSamples) -> None:
    point = (samples.displacement_ratio, samples.engine_speed, samples.load_torque)
    residual = 100.0 * (samples.efficiency - model.efficiency(*point, samples.oil_temperature))
    ratio = model.output_speed(*point, samples.oil_temperature) / samples.engine_speed
    numbered = len(samples) <= 30  # more numbers than that the eye cannot part
    axes.plot(samples.engine_speed / RPM, ratio, "o", ms=9, mfc="w", mec="k", mew=1.8, ls="none",
              clip_on=False, label="bench, measured - predicted" if numbered else "bench")
    if not numbered:
        return
    for x, y, gap in zip(samples.engine_speed / RPM, ratio, residual, strict=True):
        axes.annotate(f"{gap:+.1f}", (x, y), xytext=(8, 6), textcoords="offset points",
                      fontsize=12, bbox={"boxstyle": "round,pad=0.15", "fc": "w", "ec": "none",
                                         "alpha": 0.85})

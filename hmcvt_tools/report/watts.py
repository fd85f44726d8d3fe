# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the watts go at the usual operating point of a diagnosis, before and after."""

from __future__ import annotations

from operator import methodcaller
from typing import Any

import numpy as np

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.stages import main_stage, stages_of
from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.transmission.ranges import RPM, Array

from .losses import Balance, lost_power, scale, stack, worth_drawing
from .style import few_ticks, icon, loss_style, styled, to_svg


def watts(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return where the watts go at the median speed and load, before and after.

    Of several stages the one with most samples is shown.

    Returns:
        The `figures`; the `stage`; engine `speed` [rad/s] and `load` [N m]; `means`: part, mean
        watts before and after over the points that both models answer, NaN if there is none, the
        total last; `shares`: whether every effect added takes watts itself.
    """
    stage = main_stage(diagnosis.samples) or str(diagnosis.base.stage.name)
    base = diagnosis.base.in_stage(stage)
    model = diagnosis.model.in_stage(stage)
    samples = _of_stage(diagnosis.samples, stage)
    speed = float(np.median(samples.engine_speed))
    load = float(np.median(samples.load_torque))
    oil_temperature = None
    if samples.oil_temperature is not None:
        oil_temperature = float(np.median(samples.oil_temperature))
    before = lost_power(base, speed, load, oil_temperature)
    panels = {"Base model, refitted": before}
    after = before
    has_added = diagnosis.model is not diagnosis.base
    if has_added:
        after = lost_power(model, speed, load, oil_temperature)
        panels["With the effect added"] = after
    parts = worth_drawing(before, after)
    return {
        "figures": (_drawings(panels, parts), _legend(parts)),
        "means": _means(before, after, parts),
        "stage": stage,
        "speed": speed,
        "load": load,
        "rpm": RPM,
        "shares": not has_added or bool(after.keys() - before.keys()),
    }


def stage_watts(diagnosis: Diagnosis) -> list[tuple[str, str, str, str]]:
    """Return rows of the stages: samples, mean watts lost before and after.

    Empty where the samples are of one stage.
    """
    stages = stages_of(diagnosis.samples)
    if len(stages) < 2:
        return []
    rows = []
    for stage in stages:
        samples = _of_stage(diagnosis.samples, stage)
        before = _mean_loss(diagnosis.base, stage, samples)
        after = _mean_loss(diagnosis.model, stage, samples)
        rows.append(
            (
                stage,
                str(len(samples)),
                words.fixed(before, 0),
                words.fixed(after, 0),
            )
        )
    return rows


def _mean_loss(model: EfficiencyModel, stage: str, samples: BenchSamples) -> float:
    """Return the mean power lost over samples of one stage [W]; NaN without an answer."""
    loss = model.in_stage(stage).power_loss(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque
    )
    known = np.asarray(loss)[np.isfinite(loss)]
    return float(known.mean()) if len(known) else float("nan")


def _of_stage(samples: Any, stage: str) -> Any:
    """Return the samples of a stage; all of them where they name none."""
    names = samples.extra.get("stage")
    if names is None:
        return samples
    return samples.select(np.array([str(name) == stage for name in names]))


def _means(
    before: Balance, after: Balance, parts: list[str]
) -> list[tuple[str, float, float]]:
    total_before = sum(before.values())
    total_after = sum(after.values())
    answered = np.isfinite(total_before + total_after)
    means = []
    for part in parts:
        lost_before = _mean(before.get(part, 0.0), answered)
        means.append((part, lost_before, _mean(after.get(part, 0.0), answered)))
    means.append(("total", _mean(total_before, answered), _mean(total_after, answered)))
    return means


def _mean(loss: Any, answered: Any) -> float:
    known = np.broadcast_to(loss, answered.shape)[answered]
    return float(known.mean()) if len(known) else float("nan")


def _drawings(panels: dict[str, dict[str, Array]], parts: list[str]) -> list[str]:
    low, high = scale(*panels.values())
    drawings = []
    for number, (title, balance) in enumerate(panels.items()):
        kilowatts = {part: lost / 1e3 for part, lost in balance.items()}
        with styled() as figure:
            axes = figure.subplots()
            stack(axes, kilowatts, parts)
            axes.set(
                title=title, ylabel="power lost [kW]", ylim=(low / 1e3, high / 1e3)
            )
            few_ticks(axes)
            heading = f"{title}: power lost in each part over displacement ratio"
            drawings.append(
                to_svg(figure, f"watts-{number}", heading, _tips(kilowatts))
            )
    return drawings


def _tips(kilowatts: dict[str, Array]) -> dict[str, str]:
    tips = {}
    for part, lost in kilowatts.items():
        if np.any(np.isfinite(lost)):
            low = words.fixed(np.nanmin(lost), 2)
            high = words.fixed(np.nanmax(lost), 2)
            tips[part] = f"{part}: {low} to {high} kW"
    return tips


def _legend(parts: list[str]) -> list[tuple[str, str]]:
    """Return the legend, in the order of the stack from top to bottom."""
    legend = []
    for number, part in enumerate(parts):
        fill = methodcaller(
            "fill_between", (0.05, 0.95), 0.05, 0.95, **loss_style(part)
        )
        legend.append((part, icon(f"part-{number}", fill)))
    return legend[::-1]

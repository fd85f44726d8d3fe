# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How pictures and tables show the axes of a diagnosis, and its samples along them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.system import Axis
from hmcvt_core.transmission.ranges import RPM, Array

Rows = NDArray[np.intp]

MOST = 300
"""Marks in a picture and rows in a table; of more samples an even part is shown."""


class Scale(NamedTuple):
    """How an axis is shown.

    Attributes:
        label: of the axis, with its unit.
        factor: from SI to that unit.
        digits: decimals.
        sentence: a value in words; `{}` is the number.
    """

    label: str
    factor: float
    digits: int
    sentence: str


class Column(NamedTuple):
    """A column of a table of operating points.

    Attributes:
        heading: with the unit.
        axis: name of the axis.
        factor: from SI to that unit.
        digits: decimals.
    """

    heading: str
    axis: str
    factor: float
    digits: int


# Axes that are shown in another unit than they are kept in, or in particular words.
_SCALES = {
    "displacement_ratio": Scale(
        "displacement ratio [-]", 1.0, 2, "displacement ratio {}"
    ),
    "engine_speed": Scale("engine speed [r/min]", 1.0 / RPM, 0, "{} r/min"),
    "load_torque": Scale("load torque [N·m]", 1.0, 0, "{} N·m"),
    "speed": Scale("speed [r/min]", 1.0 / RPM, 0, "{} r/min"),
    "pressure": Scale("pressure [bar]", 1e-5, 0, "{} bar"),
    "oil_temperature": Scale("oil temperature [°C]", 1.0, 0, "{} °C"),
}

_NOT_MAPPED = ("stage",)
"""Recorded axes over which no gap is drawn: every stage has a map of itself."""


def scale_of(axis: Axis) -> Scale:
    """Return how an axis is shown, by default as it describes itself."""
    if axis.name in _SCALES:
        return _SCALES[axis.name]
    unit = "" if axis.unit == "-" else f" {axis.unit}"
    sentence = f"{axis.word} {{}}{unit}"
    return Scale(f"{axis.word} [{axis.unit}]", 1.0, axis.digits, sentence)


def map_axes(diagnosis: Diagnosis) -> tuple[Axis, ...]:
    """Return the axes over which a gap is drawn: the steered ones, and recorded ones that vary."""
    recorded = []
    for axis in diagnosis.posterior.base_only.fit.observed.axes:
        if axis.steered or axis.name in _NOT_MAPPED:
            continue
        values = getattr(diagnosis.samples, axis.name, None)
        if values is not None and np.ptp(values) > axis.tolerance:
            recorded.append(axis)
    return (*diagnosis.axes, *recorded)


def value_in_words(axis: Axis, value: float) -> str:
    """Return an axis and a value along it [SI] in words, such as `engine speed 1432 r/min`."""
    scale = scale_of(axis)
    text = scale.sentence.format(words.fixed(value * scale.factor, scale.digits))
    if text.startswith(axis.word):
        return text
    return f"{axis.word} {text}"


def shown(samples: Any, axis: Axis) -> Array:
    """Return the values of samples along an axis, in the unit shown, shape (n,)."""
    return np.asarray(getattr(samples, axis.name)) * scale_of(axis).factor


def columns(diagnosis: Diagnosis) -> list[Column]:
    """Return the columns that state an operating point; speeds come in both units."""
    result = []
    for axis in diagnosis.axes:
        scale = scale_of(axis)
        result.append(Column(scale.label, axis.name, scale.factor, scale.digits))
        if scale.label.endswith("[r/min]"):
            heading = scale.label.replace("r/min", "rad/s")
            result.append(Column(heading, axis.name, 1.0, 1))
    return result


def sample_names(diagnosis: Diagnosis, samples: Any) -> list[str]:
    """Return the name of each sample: its row in the file, if it was read from one."""
    prefix = "" if samples is diagnosis.samples else "held-out "
    rows = getattr(samples, "rows", ())
    if rows:
        return [f"{prefix}row {row}" for row in rows]
    return [f"{prefix}test {number}" for number in range(1, len(samples) + 1)]


def rows_of_stage(samples: Any, stage: str | None) -> Rows:
    """Return the samples of a stage; all of them if it is None."""
    if stage is None:
        return np.arange(len(samples))
    names = np.array([str(name) for name in samples.extra["stage"]])
    return np.flatnonzero(names == stage)


def in_words(
    diagnosis: Diagnosis, samples: Any, values: Array, rows: Rows
) -> list[str]:
    """Return a sentence for each of the chosen samples with its residual.

    Args:
        diagnosis: names axes and channel.
        samples: n of them.
        values: their residuals, shape (n,).
        rows: which samples are chosen.
    """
    names = sample_names(diagnosis, samples)
    sentences = []
    for row in rows:
        point = []
        for axis in diagnosis.axes:
            scale = scale_of(axis)
            value = shown(samples, axis)[row]
            point.append(scale.sentence.format(words.fixed(value, scale.digits)))
        residual = words.amount(diagnosis, values[row], sign=True)
        sentences.append(f"{names[row]}: {', '.join(point)}: {residual}")
    return sentences


def picked(values: Array) -> Rows:
    """Return the samples that are drawn: those with a residual, or an even part of them."""
    known = np.flatnonzero(np.isfinite(values))
    return known[:: step(len(known))]


def step(count: int) -> int:
    """Return every how many samples one is shown."""
    return max(1, -(-count // MOST))  # rounded up

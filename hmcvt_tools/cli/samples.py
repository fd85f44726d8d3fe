# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples and the predictions of a model, as records and as a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from hmcvt_core.files.bench import BenchSamples
from hmcvt_core.model.domain import AXES
from hmcvt_core.model.model import EfficiencyModel

_DOMAIN = {True: "inside", False: "outside", None: "unknown"}


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of right-aligned columns."""
    lines = [list(head)]
    for row in rows:
        lines.append(list(row))
    widths = []
    for column in zip(*lines, strict=True):
        widths.append(max(map(len, column)))
    text = []
    for line in lines:
        cells = [cell.rjust(width) for cell, width in zip(line, widths, strict=True)]
        text.append("  ".join(cells))
    return "\n".join(text)


def sample_records(
    model: EfficiencyModel, samples: BenchSamples, numbers: Sequence[int] = ()
) -> list[dict[str, Any]]:
    """Return one record per sample.

    Args:
        model: predicts.
        samples: bench samples, n of them.
        numbers: of the samples in their file; 1 to n when left out.

    Returns:
        n records. `error` is (predicted - measured) / measured; `inside_domain` is None for a
        model that does not state the range of its data; `stage` stands where the samples name it.
    """
    prediction = model.predict(*samples.points)
    errors = (prediction.efficiency - samples.efficiency) / samples.efficiency
    stages = samples.points.stage
    records = []
    for i, number in enumerate(numbers or range(1, len(samples) + 1)):
        record: dict[str, Any] = {"sample": number}
        if stages is not None:
            record["stage"] = str(stages[i])
        for axis in AXES:
            record[axis] = float(getattr(samples, axis)[i])
        record["measured"] = float(samples.efficiency[i])
        record["predicted"] = float(prediction.efficiency[i])
        record["standard_error"] = float(prediction.standard_error[i])
        record["inside_domain"] = None
        if model.domain is not None:
            record["inside_domain"] = bool(prediction.inside_domain[i])
        record["error"] = float(errors[i])
        records.append(record)
    return records


def sample_table(records: Sequence[dict[str, Any]]) -> str:
    """Return the records as a table; `-` where the model has no answer."""
    head = [
        "sample",
        "ratio [-]",
        "engine [rad/s]",
        "load [N m]",
        "measured",
        "predicted",
        "std error",
        "error",
        "domain",
    ]
    has_stage = "stage" in records[0]
    if has_stage:
        head.insert(1, "stage")
    rows = []
    for record in records:
        row = [
            str(record["sample"]),
            f"{record['displacement_ratio']:.3f}",
            f"{record['engine_speed']:.2f}",
            f"{record['load_torque']:.2f}",
            f"{record['measured']:.4f}",
            _number(record["predicted"], ".4f"),
            _number(record["standard_error"], ".4f"),
            _number(100.0 * record["error"], "+.2f", " %"),
            _DOMAIN[record["inside_domain"]],
        ]
        if has_stage:
            row.insert(1, record["stage"])
        rows.append(row)
    return table(head, rows)


def _number(value: float, form: str, unit: str = "") -> str:
    if math.isnan(value):
        return "-"
    return f"{value:{form}}{unit}"

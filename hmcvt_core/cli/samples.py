# SPDX-License-Identifier: Apache-2.0
"""Measured beside predicted: a model at bench samples, as records and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from .common import number, table

_HEAD = ("sample", "ratio [-]", "engine [rad/s]", "load [N m]", "measured", "predicted",
         "std error", "error", "domain")
_DOMAIN = {True: "inside", False: "outside", None: "unknown"}


def sample_records(
    model: EfficiencyModel, samples: BenchSamples, numbers: Sequence[int] = ()
) -> list[dict[str, Any]]:
    """Return one record per sample; `error` is (predicted - measured) / measured.

    `numbers` are those of the samples in their file; 1, 2, ... when left out.
    """
    found = model.predict(samples.displacement_ratio, samples.engine_speed, samples.load_torque,
                          samples.oil_temperature)
    error = (found.efficiency - samples.efficiency) / samples.efficiency
    return [{
        "sample": numbers[i] if numbers else i + 1,
        "displacement_ratio": float(samples.displacement_ratio[i]),
        "engine_speed": float(samples.engine_speed[i]),
        "load_torque": float(samples.load_torque[i]),
        "measured": float(samples.efficiency[i]),
        "predicted": float(found.efficiency[i]),
        "standard_error": float(found.standard_error[i]),
        # None, not false, for a model that does not say what data it comes from.
        "inside_domain": None if model.domain is None else bool(found.inside_domain[i]),
        "error": float(error[i]),
    } for i in range(len(samples))]


def sample_table(records: Sequence[dict[str, Any]]) -> str:
    """Return the records as a table; `-` where the model has no answer."""
    return table(_HEAD, [(
        str(entry["sample"]), f"{entry['displacement_ratio']:.3f}",
        f"{entry['engine_speed']:.2f}", f"{entry['load_torque']:.2f}",
        f"{entry['measured']:.4f}", number(entry["predicted"], ".4f"),
        number(entry["standard_error"], ".4f"), number(100 * entry["error"], "+.2f", " %"),
        _DOMAIN[entry["inside_domain"]]) for entry in records])

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Residuals by the stage that samples name, for the report and the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..analysis import rms
from ..system import Array
from .outcome import Outcome
from .sentences import amount


def stages_of(samples: Any) -> list[str]:
    """Return the stages that samples name, in alphabetical order."""
    return sorted(set(_stage_names(samples)))


def main_stage(samples: Any) -> str | None:
    """Return the stage with most samples; None where they name none."""
    names = _stage_names(samples)
    return max(dict.fromkeys(names), key=names.count, default=None)


def residuals_by_stage(samples: Any, residuals: Array) -> dict[str, Array]:
    """Return the residuals of each stage; empty where the samples are of one.

    Args:
        samples: to which the residuals belong.
        residuals: shape (n,).
    """
    stages = stages_of(samples)
    if len(stages) < 2:
        return {}
    of_sample = np.array(_stage_names(samples))
    return {stage: residuals[of_sample == stage] for stage in stages}


def mean_and_rms(outcome: Outcome, residuals: Array) -> tuple[str, str] | None:
    """Return mean and rms of residuals in words; None where the model has no answer."""
    known = residuals[np.isfinite(residuals)]
    if len(known) == 0:
        return None
    mean = amount(outcome, float(known.mean()), sign=True)
    return mean, amount(outcome, rms(known))


def _stage_names(samples: Any) -> list[str]:
    """Return the stage of each sample; empty without a column of stages."""
    return [str(name) for name in getattr(samples, "extra", {}).get("stage", ())]

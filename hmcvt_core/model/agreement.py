# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What compares a model with a bench, under one name."""

from .accuracy import carried_at, determination_loss, mean_error, relative_errors
from .operating_point import LOADS, STROKES, operating_point
from .plausibility import gear_train_remark, gear_train_remarks, pressure_remark
from .staged_samples import by_stage, stage_of_each

__all__ = [
    "LOADS",
    "STROKES",
    "by_stage",
    "carried_at",
    "determination_loss",
    "gear_train_remark",
    "gear_train_remarks",
    "mean_error",
    "operating_point",
    "pressure_remark",
    "relative_errors",
    "stage_of_each",
]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of a change against the baseline of a sound machine."""

from .change import (
    CLASS_TO_DRIFT,
    Change,
    SoundMachine,
    different_curves,
    with_sound_uncertainty,
)
from .comparison import ChangeDiagnosis, Reference, compare
from .control import Control, control_and_rest, exceeds_baseline, judge_control
from .record import Baseline

__all__ = [
    "CLASS_TO_DRIFT",
    "Baseline",
    "Change",
    "ChangeDiagnosis",
    "Control",
    "Reference",
    "SoundMachine",
    "compare",
    "control_and_rest",
    "different_curves",
    "exceeds_baseline",
    "judge_control",
    "with_sound_uncertainty",
]

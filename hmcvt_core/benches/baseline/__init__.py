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
from .control import Control, control_and_rest, judge_control
from .growth import Growth
from .record import Baseline
from .refusal import leading_effects, refuse_contradicted, without_absent

__all__ = [
    "CLASS_TO_DRIFT",
    "Baseline",
    "Change",
    "ChangeDiagnosis",
    "Control",
    "Growth",
    "Reference",
    "SoundMachine",
    "compare",
    "control_and_rest",
    "different_curves",
    "judge_control",
    "leading_effects",
    "refuse_contradicted",
    "with_sound_uncertainty",
    "without_absent",
]

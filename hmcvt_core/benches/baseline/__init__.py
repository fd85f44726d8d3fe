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
from .held import (
    FEWEST_CHANGED,
    HeldMachine,
    extrapolation_notes,
    min_widths,
    stacked,
)
from .record import Baseline
from .refusal import leading_effects, refuse_contradicted, without_absent

__all__ = [
    "CLASS_TO_DRIFT",
    "FEWEST_CHANGED",
    "Baseline",
    "Change",
    "ChangeDiagnosis",
    "Control",
    "Growth",
    "HeldMachine",
    "Reference",
    "SoundMachine",
    "compare",
    "control_and_rest",
    "different_curves",
    "extrapolation_notes",
    "judge_control",
    "leading_effects",
    "min_widths",
    "refuse_contradicted",
    "stacked",
    "with_sound_uncertainty",
    "without_absent",
]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a diagnosis of a change against a sound baseline has in common for every machine.

`transmission.change` and `unit.change` use it: each has a sound machine of its own (`sound`).

held        what sound machines share: a smooth `remainder` of each channel with its uncertainty
change      the `System` whose effects are changes since then
comparison  from a sound machine and later samples to the diagnosis of the change
control     sound samples left out of the fit, which must come out as no change
refusal     leading sets that their refit contradicts, left out of the verdict (also of a unit
            without baseline)
growth      how much a loss has grown, as a fraction of that of the sound machine
sizes       size of a change from all sets that hold it
record      the `Baseline` of a diagnosis; limits its verdict to what the tests can show
"""

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

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between a model and a bench, for any system.

system        what the diagnosis has to know of a machine
observations  readings of the bench, channel by channel, and their noise
pipeline      the steps in order: `diagnose_system`, `next_test`
preparation   which samples count, with which noise; the base model refitted to them
fitting       refits of hypotheses and their evidence
detection     whether there is a gap: one p value over all regions and effects
selection     explanations that compete, and their probabilities
design        the next test; which effects a plan can distinguish
statements    what the evidence supports, up to the verdict
analysis      detection and selection of one campaign, as `statements` and `results` read them
results       the outcome: causes, where the gap is, shrinkage, text
wording       numbers, probabilities and names in sentences and tables
settings      thresholds, priors and counts of the inference, with their sources
"""

from .design.advice import Advice, NextTest
from .design.isolability import Isolability, isolability
from .pipeline import diagnose_system, next_test
from .results.diagnosis import Diagnosis
from .results.outcome import Cause, CauseSet, Gap, Region, ShrinkageSummary

__all__ = [
    "Advice",
    "Cause",
    "CauseSet",
    "Diagnosis",
    "Gap",
    "Isolability",
    "NextTest",
    "Region",
    "ShrinkageSummary",
    "diagnose_system",
    "isolability",
    "next_test",
]

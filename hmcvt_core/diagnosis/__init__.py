# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between a model and a bench, for any system: see `system`."""

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

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between a model and a bench, whatever stands on it: see `system`."""

from .design.isolability import Isolability, isolability
from .design.next_test import Advice, NextTest
from .pipeline import diagnose_system, next_test
from .results.outcome import Cause, CauseSet, Gap, Region, ShrinkageSummary
from .results.text import Diagnosis

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

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between a model and a bench, whatever stands on it: see `system`."""

from .advice import Advice, NextTest
from .plans import Isolability, isolability
from .procedure import diagnose_system, next_test
from .result import Cause, CauseSet, Gap, Region, ShrinkageSummary
from .words import Diagnosis

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

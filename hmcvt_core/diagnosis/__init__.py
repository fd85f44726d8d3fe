# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between model and bench."""

from .isolability import Isolability, separable
from .procedure import diagnose
from .result import Cause, Diagnosis, Gap, NextTest, Region, ShrinkageSummary

__all__ = [
    "Cause", "Diagnosis", "Gap", "Isolability", "NextTest", "Region", "ShrinkageSummary",
    "diagnose", "separable",
]

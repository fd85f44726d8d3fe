# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A transmission on a bench: the system that the diagnosis examines, and its entry points."""

from .analyses import diagnose, next_test, read_plan, separable
from .change import shared_test_notes
from .channels import (
    AXES,
    CHANNELS,
    EFFICIENCY_CHANNEL,
    OIL_TEMPERATURE,
    STAGE,
)
from .readings import observe
from .served import EmpiricalRemainder, with_empirical_remainder, without_remainder
from .system import Transmission

__all__ = [
    "AXES",
    "CHANNELS",
    "EFFICIENCY_CHANNEL",
    "OIL_TEMPERATURE",
    "STAGE",
    "EmpiricalRemainder",
    "Transmission",
    "diagnose",
    "next_test",
    "observe",
    "read_plan",
    "separable",
    "shared_test_notes",
    "with_empirical_remainder",
    "without_remainder",
]

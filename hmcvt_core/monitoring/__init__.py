# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Monitoring of the gap: a sequential test on measured less predicted efficiency."""

from .change_test import FALSE_ALARMS, ChangeTest, step_size
from .watch import Opening, Watch, watch

__all__ = [
    "FALSE_ALARMS",
    "ChangeTest",
    "Opening",
    "Watch",
    "step_size",
    "watch",
]

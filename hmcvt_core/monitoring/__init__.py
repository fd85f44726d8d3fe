# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Watch on a stream of bench samples: has a gap opened, since when, how large.

watch        model and samples in, an `Opening` out
change_test  the sequential test, with a bounded chance of false alarms
"""

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

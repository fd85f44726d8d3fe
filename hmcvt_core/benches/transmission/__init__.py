# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A transmission on a bench: the system that the diagnosis examines, and its entry points.

analyses    `diagnose`, `next_test`, `separable`
system      the model as a `System`: predictions, base parameters, candidate effects
channels    axes and channels, from the registry of quantities
readings    bench samples as observations
base        base parameters and their priors
meters      errors of meters that a session shares (`meter_scale`: zeros of the torque meters)
unrecorded  what may vary although nothing records it
served      the model that is saved: the best of three predictions, one of which corrects it by
            `bumps` of a `gaussian_process`; `misfit` states what it misses
change      diagnosis of a change since the transmission was `sound`
"""

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
from .served import without_remainder
from .system import Transmission

__all__ = [
    "AXES",
    "CHANNELS",
    "EFFICIENCY_CHANNEL",
    "OIL_TEMPERATURE",
    "STAGE",
    "Transmission",
    "diagnose",
    "next_test",
    "observe",
    "read_plan",
    "separable",
    "shared_test_notes",
    "without_remainder",
]

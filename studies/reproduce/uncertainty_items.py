# SPDX-License-Identifier: Apache-2.0
"""Measurement uncertainty, eqs (1)-(3)."""

from __future__ import annotations

import math

from . import paper
from .item import Item, printed

GROUP = "Measurement uncertainty, eqs (1)-(3)"


def items() -> list[Item]:
    """The five printed uncertainties."""
    expected = paper.Uncertainties()
    torque, speed = paper.TORQUE_READINGS, paper.SPEED_READINGS
    random = [100.0 * deviation / mean for mean, deviation in (torque, speed)]  # (1)
    uniform = 100.0 / math.sqrt(3.0)  # (2): the largest error, uniformly distributed
    system = [uniform * error / full for error, full in (paper.TORQUE_SENSOR, paper.SPEED_SENSOR)]
    at_reading = uniform * paper.TORQUE_SENSOR[0] / torque[0]
    speed_at_reading = uniform * paper.SPEED_SENSOR[0] * math.pi / 30.0 / speed[0]
    total = math.hypot(*random, *system)  # (3)
    return [
        printed(GROUP, "random, torque [%]", expected.torque_random, random[0], ".2f"),
        printed(GROUP, "random, speed [%]", expected.speed_random, random[1], ".2f"),
        printed(GROUP, "systematic, torque [%]", expected.torque_system, system[0], ".2f",
                remark=f"of the full range; of the reading itself (2) gives {at_reading:.2f} %"),
        printed(GROUP, "systematic, speed [%]", expected.speed_system, system[1], ".3f",
                remark=f"of the full range; of the reading itself {speed_at_reading:.3f} %"),
        printed(GROUP, "total [%]", expected.total, total, ".2f"),
    ]

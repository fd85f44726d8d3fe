# SPDX-License-Identifier: Apache-2.0
"""The two outputs: what is published for an operating point, and what where there is no answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from std_msgs.msg import Float64

from hmcvt_core import EfficiencyModel

from . import messages, qos
from .inputs import OperatingPoint
from .parameters import NAN, Settings


class Outputs:
    """`efficiency` and `optimal_displacement_ratio`.

    Attributes:
        answered: count of operating points that got an efficiency.
        refusal: why the last operating point got none; empty when it got one.
    """

    def __init__(self, create_publisher: Callable[..., Any]) -> None:
        self.answered = 0
        self.refusal = ""
        self._efficiency = create_publisher(Float64, "efficiency", qos.OUTPUT)
        self._optimum = create_publisher(Float64, "optimal_displacement_ratio", qos.OUTPUT)
        self._asked: tuple[Any, ...] | None = None
        self._found = math.nan

    def answer(self, model: EfficiencyModel, point: OperatingPoint, settings: Settings) -> None:
        """Publish what the model says at an operating point."""
        efficiency = model.efficiency(*point)
        # Out with it at once: the optimum takes longer to find.
        _publish(self._efficiency, efficiency, settings)
        if math.isfinite(efficiency):
            self.answered += 1
            self.refusal = ""
        else:
            self.refusal = model.refusal(*point) or ""
        ratio = point.displacement_ratio if settings.optimum_hold == "output_speed" else None
        asked = (model, point.engine_speed, point.load_torque, ratio, settings.optimum_hold,
                 settings.engine_speed_limits)
        if asked != self._asked:  # most often it is the same as the last time
            self._found = model.optimal_displacement_ratio(
                point.engine_speed, point.load_torque, hold=settings.optimum_hold,
                displacement_ratio=ratio,
                engine_speed_limits=settings.engine_speed_limits).displacement_ratio
            self._asked = asked
        _publish(self._optimum, self._found, settings)

    def deny(self) -> None:
        """Publish NaN: there is no operating point to answer."""
        for publisher in (self._efficiency, self._optimum):
            publisher.publish(messages.float64(math.nan))


def _publish(publisher: Any, value: float, settings: Settings) -> None:
    # Silence unless NaN is asked for: a controller takes a number for what it is.
    if math.isfinite(value) or settings.invalid_output == NAN:
        publisher.publish(messages.float64(value))

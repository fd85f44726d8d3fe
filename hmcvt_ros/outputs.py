# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outputs: what is published for an operating point, and what where there is no answer."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from hmcvt_core import EfficiencyModel, Engine

from . import qos
from .inputs import OperatingPoint
from .parameters import NAN, Settings

ADVICE = (
    "efficiency",
    "efficiency_std",
    "extrapolated",
    "power_loss",
    "optimal_displacement_ratio",
    "optimal_engine_speed",
    "fuel_rate",
)
"""The names in `advice`; the last one is that of the point asked, NaN without an engine."""


class Served(NamedTuple):
    """What answers: the model of the stage engaged, among all stages, and the engine if known."""

    model: EfficiencyModel
    transmission: EfficiencyModel
    engine: Engine | None


class Outputs:
    """The plain outputs and `advice`.

    Attributes:
        answered: count of operating points that got an efficiency.
        refusal: why the last operating point got none; empty when it got one.
    """

    def __init__(self, create_publisher: Callable[..., Any]) -> None:
        self.answered = 0
        self.refusal = ""
        # Each with a message of its own, which is filled anew: to make one takes longer.
        self._efficiency, self._stroke, self._speed = (
            (create_publisher(Float64, topic, qos.OUTPUT), Float64())
            for topic in (
                "efficiency",
                "optimal_displacement_ratio",
                "optimal_engine_speed",
            )
        )
        self._stage = create_publisher(String, "optimal_stage", qos.OUTPUT)
        self._advice = create_publisher(JointState, "advice", qos.OUTPUT)
        # Most often the question is the same as the last time, on the topics and in the advice.
        self._best = functools.lru_cache(2)(_best)

    def answer(self, served: Served, point: OperatingPoint, settings: Settings) -> None:
        """Publish what the model says at an operating point."""
        model = served.model
        efficiency = model.efficiency(*point)
        # Out with it at once: the optimum takes longer to find.
        _publish(self._efficiency, efficiency, settings)
        if math.isfinite(efficiency):
            self.answered += 1
            self.refusal = ""
        else:
            self.refusal = model.refusal(*point) or ""
        stroke, speed, stage = self._best(*_asked(served, point, settings))
        _publish(self._stroke, stroke, settings)
        _publish(self._speed, speed, settings)
        if stage is not None:
            self._stage.publish(String(data=stage))

    def deny(self) -> None:
        """Publish NaN: there is no operating point to answer."""
        for publisher, message in (self._efficiency, self._stroke, self._speed):
            message.data = math.nan
            publisher.publish(message)

    def advise(
        self,
        served: Served,
        asked: JointState,
        point: OperatingPoint | None,
        settings: Settings,
    ) -> None:
        """Answer a message on `operating_point`; with NaN where it holds no point to answer."""
        values, model = [math.nan] * len(ADVICE), served.model
        if point is not None:
            found = model.predict(*point)
            extrapolated = (
                math.nan if model.domain is None else float(not found.inside_domain)
            )
            loss = model.power_loss(*point)
            fuel = (
                math.nan
                if served.engine is None
                else served.engine.fuel_rate(
                    point.engine_speed, point.load_torque + loss / point.engine_speed
                )
            )
            values = [
                found.efficiency,
                found.standard_error,
                extrapolated,
                loss,
                *self._best(*_asked(served, point, settings))[:2],
                fuel,
            ]
        answer = JointState(header=asked.header, name=list(ADVICE), position=values)
        answer.header.frame_id = f"{served.transmission.fingerprint}:{model.stage.name}"
        self._advice.publish(answer)


def _asked(
    served: Served, point: OperatingPoint, settings: Settings
) -> tuple[Any, ...]:
    """What the optimum depends on: the displacement ratio only where it tells the output speed."""
    ratio = (
        point.displacement_ratio if settings.optimum_hold == "output_speed" else None
    )
    return (
        served,
        point.engine_speed,
        point.load_torque,
        settings.optimum_hold,
        ratio,
        settings.engine_speed_limits,
    )


def _best(
    served: Served,
    engine_speed: float,
    load_torque: float,
    hold: str,
    ratio: float | None,
    limits: tuple[float, float],
) -> tuple[float, float, str | None]:
    """Return the best displacement ratio [-], its engine speed [rad/s] and stage.

    At a held output speed the drive line is free where there are several stages or an engine.
    """
    model = served.model
    if ratio is not None and (
        served.engine is not None or served.transmission.other_stages
    ):
        found = served.transmission.optimal_drive(
            model.output_speed(ratio, engine_speed, load_torque),
            engine_speed * load_torque,
            engine=served.engine,
            engine_speed_limits=limits,
        )
        return found.displacement_ratio, found.engine_speed, found.stage
    best = model.optimal_displacement_ratio(
        engine_speed,
        load_torque,
        hold=hold,
        displacement_ratio=ratio,
        engine_speed_limits=limits,
    )
    # An engine speed belongs to a displacement ratio, and there is none without it.
    if not math.isfinite(best.displacement_ratio):
        return math.nan, math.nan, None
    return best.displacement_ratio, best.engine_speed, model.stage.name


def _publish(output: tuple[Any, Float64], value: float, settings: Settings) -> None:
    # Silence unless NaN is asked for: a controller takes a number for what it is.
    if math.isfinite(value) or settings.invalid_output == NAN:
        publisher, message = output
        message.data = value
        publisher.publish(message)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outputs: what is published for an operating point, and what where there is no answer."""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from hmcvt_core import EfficiencyModel, Engine
from hmcvt_core.interface import HOLDS
from hmcvt_tools import Controller, Drive, Vehicle

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
    "hold",
)
"""Names in `advice`. The fuel rate is that of the point asked, NaN without an engine. `hold` is the
position of `optimum_hold` in `HOLDS`: 0 engine_speed, 1 output_speed."""
ASSUMED_OIL = 60.0
"""Oil temperature of a model where none is known [deg C]."""
# Chosen by us: the oil of a tractor at work has 35 to 85 deg C.
UNKNOWN_OIL_RANGE = 25.0
"""How far from `ASSUMED_OIL` an oil temperature that is not known may be, at 95 % [K]."""
# Chosen by us: sensors of oil resolve about 1 K, and a search takes longer than an answer.
_OIL_STEP = 1.0
"""Change of the oil temperature that the optimum follows [K]."""
_QUANTILE = 1.96
"""Of the normal distribution at 95 %, two-sided."""
UNKNOWN_STAGE = "unknown"
"""Stage in the `frame_id` of `advice` where the model has several and none of them is engaged."""


class Served(NamedTuple):
    """What answers.

    Attributes:
        model: of the stage engaged.
        transmission: of all stages.
        engine: before it, or None.
        vehicle: around it, with the limits of the machine; None for none.
    """

    model: EfficiencyModel
    transmission: EfficiencyModel
    engine: Engine | None
    vehicle: Vehicle | None = None


class _Question(NamedTuple):
    """What an optimum depends on.

    Attributes:
        served: what answers.
        engine_speed: [rad/s].
        load_torque: [N m].
        hold: parameter `optimum_hold`.
        displacement_ratio: [-]; None where it does not matter.
        limits: engine speeds that the optimum may use [rad/s].
        oil_temperature: [deg C]; None where it is not known, or does not matter.
    """

    served: Served
    engine_speed: float
    load_torque: float
    hold: str
    displacement_ratio: float | None
    limits: tuple[float, float]
    oil_temperature: float | None


class _Best(NamedTuple):
    """An optimum: displacement ratio [-], engine speed [rad/s], and stage; None without one."""

    displacement_ratio: float
    engine_speed: float
    stage: str | None


class _NumberOutput:
    """A topic of numbers.

    One message is filled again for every publication: creating one takes longer.
    """

    def __init__(self, create_publisher: Callable[..., Any], topic: str) -> None:
        self._publisher = create_publisher(Float64, topic, qos.OUTPUT)
        self._message = Float64()

    def publish(self, value: float) -> None:
        self._message.data = value
        self._publisher.publish(self._message)


class Outputs:
    """The plain outputs and `advice`.

    Attributes:
        answered: count of operating points that got an efficiency.
        refusal: why the last operating point got none; empty when it got one.
    """

    def __init__(self, create_publisher: Callable[..., Any]) -> None:
        self.answered = 0
        self.refusal = ""
        self._efficiency = _NumberOutput(create_publisher, "efficiency")
        self._stroke = _NumberOutput(create_publisher, "optimal_displacement_ratio")
        self._speed = _NumberOutput(create_publisher, "optimal_engine_speed")
        self._stage = create_publisher(String, "optimal_stage", qos.OUTPUT)
        self._stage_message = String()
        self._advice = create_publisher(JointState, "advice", qos.OUTPUT)
        # Filled again for every publication, as in `_NumberOutput`.
        self._advice_message = JointState(name=list(ADVICE))
        # Most often the question is that of the last time, on the topics and in the advice.
        self._best = functools.lru_cache(2)(_best)

    def answer(
        self,
        served: Served,
        point: OperatingPoint,
        settings: Settings,
        oil_temperature: float | None = None,
    ) -> None:
        """Publish the answer of the model at an operating point.

        Args:
            served: what answers.
            point: operating point.
            settings: parameters of the node.
            oil_temperature: [deg C]; None where it is not known, or does not matter.
        """
        efficiency = served.model.efficiency(*point, oil_temperature)
        # At once: the optimum takes longer to find.
        _publish(self._efficiency, efficiency, settings)
        if math.isfinite(efficiency):
            self.answered += 1
            self.refusal = ""
        else:
            self.refusal = served.model.refusal(*point, oil_temperature) or ""
        best = self._best(_question(served, point, settings, oil_temperature))
        _publish(self._stroke, best.displacement_ratio, settings)
        _publish(self._speed, best.engine_speed, settings)
        if best.stage is not None:
            self._stage_message.data = best.stage
            self._stage.publish(self._stage_message)

    def deny(self) -> None:
        """Publish NaN: there is no operating point to answer."""
        for output in (self._efficiency, self._stroke, self._speed):
            output.publish(math.nan)

    def advise(
        self,
        served: Served,
        message: JointState,
        point: OperatingPoint | None,
        settings: Settings,
        stage_known: bool = True,
        oil_temperature: float | None = None,
    ) -> None:
        """Answer a message on `operating_point`.

        Args:
            served: what answers.
            message: message that asks.
            point: operating point in the message; None for an answer of NaN.
            settings: parameters of the node.
            stage_known: whether the stage engaged is a stage of the model.
            oil_temperature: [deg C]; None where it is not known, or does not matter.
        """
        values = [math.nan] * len(ADVICE)
        if point is not None:
            values = self.advice_values(served, point, settings, oil_temperature)
        stage = served.model.stage.name if stage_known else UNKNOWN_STAGE
        answer = self._advice_message
        answer.header = message.header
        answer.position = values
        answer.header.frame_id = f"{served.transmission.fingerprint}:{stage}"
        self._advice.publish(answer)

    def optimal_stage(
        self,
        served: Served,
        point: OperatingPoint,
        settings: Settings,
        oil_temperature: float | None,
    ) -> str:
        """Return the stage of the optimum; empty without one. Arguments as of `advise`."""
        best = self._best(_question(served, point, settings, oil_temperature))
        return best.stage or ""

    def advice_values(
        self,
        served: Served,
        point: OperatingPoint,
        settings: Settings,
        oil_temperature: float | None,
    ) -> list[float]:
        """Return the values of `ADVICE` at a point; arguments as of `advise`."""
        model = served.model
        prediction = model.predict(*point, oil_temperature)
        deviation = prediction.standard_error
        if oil_temperature is None and depends_on_oil(model):
            deviation = math.hypot(deviation, _std_of_unknown_oil(model, point))
        extrapolated = math.nan
        if model.domain is not None:
            extrapolated = float(not prediction.inside_domain)
        loss = model.power_loss(*point, oil_temperature)
        fuel_rate = math.nan
        if served.engine is not None:
            engine_torque = point.load_torque + loss / point.engine_speed
            fuel_rate = served.engine.fuel_rate(point.engine_speed, engine_torque)
        best = self._best(_question(served, point, settings, oil_temperature))
        return [
            prediction.efficiency,
            deviation,
            extrapolated,
            loss,
            best.displacement_ratio,
            best.engine_speed,
            fuel_rate,
            float(HOLDS.index(settings.optimum_hold)),
        ]


@functools.lru_cache(32)
def depends_on_oil(model: EfficiencyModel) -> bool:
    """Whether the answers of a model of one stage depend on the oil temperature."""
    strokes, speeds, torques = np.meshgrid(
        (-0.5, 0.5, 1.0), (100.0, 200.0), (50.0, 300.0)
    )
    answers = [
        model.efficiency(strokes, speeds, torques, temperature)
        for temperature in (
            None,
            ASSUMED_OIL - UNKNOWN_OIL_RANGE,
            ASSUMED_OIL + UNKNOWN_OIL_RANGE,
        )
    ]
    return any(
        not np.array_equal(answers[0], other, equal_nan=True) for other in answers
    )


def _std_of_unknown_oil(model: EfficiencyModel, point: OperatingPoint) -> float:
    """Return the standard deviation of an efficiency, of an oil temperature that is not known."""
    assumed = model.efficiency(*point)
    changes = []
    for step in (-UNKNOWN_OIL_RANGE, UNKNOWN_OIL_RANGE):
        changed = model.efficiency(*point, ASSUMED_OIL + step)
        changes.append(abs(changed - assumed))
    return float(np.max(changes)) / _QUANTILE  # NaN where one has no answer


def _question(
    served: Served,
    point: OperatingPoint,
    settings: Settings,
    oil_temperature: float | None,
) -> _Question:
    # The displacement ratio matters only where it determines the output speed.
    ratio = None
    if settings.optimum_hold == "output_speed":
        ratio = point.displacement_ratio
    oil = None
    if oil_temperature is not None:
        oil = _OIL_STEP * round(oil_temperature / _OIL_STEP)
    return _Question(
        served,
        point.engine_speed,
        point.load_torque,
        settings.optimum_hold,
        ratio,
        settings.engine_speed_limits,
        oil,
    )


def _best(question: _Question) -> _Best:
    """Return the optimum.

    At a held output speed the drive line is free where there are several stages or an engine.
    """
    served = question.served
    model = served.model
    ratio = question.displacement_ratio
    free = served.engine is not None or bool(served.transmission.other_stages)
    if ratio is not None and served.engine is not None and served.vehicle is not None:
        drive_line = Drive(served.transmission, served.engine, served.vehicle)
        return _commanded(Controller(drive_line), question, ratio)
    if ratio is not None and free:
        drive = served.transmission.optimal_drive(
            model.output_speed(
                ratio,
                question.engine_speed,
                question.load_torque,
                question.oil_temperature,
            ),
            question.engine_speed * question.load_torque,
            engine=served.engine,
            engine_speed_limits=question.limits,
            oil_temperature=question.oil_temperature,
        )
        return _Best(drive.displacement_ratio, drive.engine_speed, drive.stage)
    best = model.optimal_displacement_ratio(
        question.engine_speed,
        question.load_torque,
        hold=question.hold,
        displacement_ratio=ratio,
        engine_speed_limits=question.limits,
        oil_temperature=question.oil_temperature,
    )
    # An engine speed belongs to a displacement ratio, and there is none without it.
    if not math.isfinite(best.displacement_ratio):
        return _Best(math.nan, math.nan, None)
    return _Best(best.displacement_ratio, best.engine_speed, model.stage.name)


def _commanded(
    controller: Controller, question: _Question, displacement_ratio: float
) -> _Best:
    """Return what the causal strategy asks for next, within the limits of the machine."""
    model = question.served.model
    command = controller.choose(
        model.output_speed(
            displacement_ratio, question.engine_speed, question.load_torque
        ),
        question.engine_speed * question.load_torque,
        model.stage.name,
        question.engine_speed,
        displacement_ratio,
    )
    if command is None:
        return _Best(math.nan, math.nan, None)
    return _Best(command.displacement_ratio, command.engine_speed, command.stage)


def _publish(output: _NumberOutput, value: float, settings: Settings) -> None:
    # Silence unless NaN is asked for: a controller takes a number for what it is.
    if math.isfinite(value) or settings.invalid_output == NAN:
        output.publish(value)

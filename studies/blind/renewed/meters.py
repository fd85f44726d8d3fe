# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Meters of the renewed plant: every one has errors that it draws anew in each session."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from studies.blind.effect import FloatArray

#: Standard deviation of scale and zero of the stroke sensor by session [-].
_STROKE = (0.002, 0.005)
#: Torque meters: full scale against the largest torque; deviations of zero (of full scale) and
#: gain by session; of zero by 10 K (data sheets: TK0); of one reading (of full scale).
_FULL_SCALE = (1.2, 2.0)
_ZERO = (0.0002, 0.0006)
_GAIN = (0.0002, 0.0006)
_WARMTH = (0.0, 0.0002)
_SCATTER = (0.0001, 0.0005)
#: Speed meters: deviation of the scale by session, and of one reading.
_SPEED_SCALE = (0.0, 0.0005)
_SPEED_SCATTER = 0.0002
#: Gauge of the loop: deviations of gain and zero by session [Pa], and of one reading (part, Pa).
_GAUGE = (0.005, 1e5)
_GAUGE_SCATTER = (0.003, 3e4)
_REFERENCE_TEMPERATURE = 50.0


@dataclass(frozen=True)
class TorqueMeter:
    """A torque meter.

    Attributes:
        zero: of each session [N m].
        gain: of each session, reading / torque - 1.
        warmth: shift of the zero with the temperature of the oil [N m/K].
        scatter: standard deviation of a reading [N m].
        zero_deviation, gain_deviation, warmth_deviation: from which they are drawn.
    """

    zero: FloatArray
    gain: FloatArray
    warmth: float
    scatter: float
    zero_deviation: float
    gain_deviation: float
    warmth_deviation: float

    def read(
        self, torque: FloatArray, session: npt.NDArray[np.int_], oil: FloatArray
    ) -> FloatArray:
        """Return readings without scatter [N m].

        Args:
            torque: true [N m], shape (n,).
            session: number of the session of each test.
            oil: temperature [deg C].
        """
        warm = self.warmth * (oil - _REFERENCE_TEMPERATURE)
        return np.asarray(
            torque * (1.0 + self.gain[session]) + self.zero[session] + warm
        )

    def columns(
        self, torque: FloatArray, session: npt.NDArray[np.int_], oil: FloatArray
    ) -> list[FloatArray]:
        """Return the change of the reading by one deviation of each error [N m]."""
        columns = [self.warmth_deviation * (oil - _REFERENCE_TEMPERATURE)]
        for number in np.unique(session):
            inside = session == number
            columns.append(self.zero_deviation * inside)
            columns.append(self.gain_deviation * torque * inside)
        return columns


@dataclass(frozen=True)
class Meters:
    """All meters of one campaign; arrays have one number a session.

    Attributes:
        engine, output: the torque meters.
        stroke_scale, stroke_zero: of the stroke sensor [-].
        engine_scale, output_scale: of the speed meters [-].
        gauge_gain, gauge_zero: of the gauge of the loop [-], [Pa].
        stroke_deviation, speed_deviation: from which the scales are drawn.
    """

    engine: TorqueMeter
    output: TorqueMeter
    stroke_scale: FloatArray
    stroke_zero: FloatArray
    engine_scale: FloatArray
    output_scale: FloatArray
    gauge_gain: FloatArray
    gauge_zero: FloatArray
    stroke_deviation: float
    speed_deviation: float

    def exact(self) -> "Meters":
        """Return the same meters without errors, but for the scatter of their readings."""
        none = np.zeros_like(self.stroke_scale)
        return replace(
            self,
            engine=replace(self.engine, zero=none, gain=none, warmth=0.0),
            output=replace(self.output, zero=none, gain=none, warmth=0.0),
            stroke_scale=none,
            stroke_zero=none,
            engine_scale=none,
            output_scale=none,
            gauge_gain=none,
            gauge_zero=none,
        )

    @property
    def speed_scatter(self) -> float:
        """Relative standard deviation of one reading of either speed."""
        return _SPEED_SCATTER

    def stroke(
        self, true_stroke: FloatArray, session: npt.NDArray[np.int_]
    ) -> FloatArray:
        """Return what the stroke sensor shows [-]."""
        scale = 1.0 + self.stroke_scale[session]
        return np.asarray(true_stroke * scale + self.stroke_zero[session])


def gauge_scatter(pressure: FloatArray) -> FloatArray:
    """Return the standard deviation of one reading of the gauge [Pa]."""
    return np.asarray(np.hypot(_GAUGE_SCATTER[0] * pressure, _GAUGE_SCATTER[1]))


def gauge_deviation() -> tuple[float, float]:
    """Return the deviations of gain [-] and zero [Pa] of the gauge by session."""
    return _GAUGE


def draw_meters(
    sessions: int,
    engine_torque: FloatArray,
    output_torque: FloatArray,
    rng: np.random.Generator,
) -> Meters:
    """Draw the meters of a campaign.

    Args:
        sessions: number of sessions.
        engine_torque, output_torque: true torques of the campaign [N m].
        rng: of the meters.
    """
    engine = _draw_torque_meter(sessions, float(np.max(engine_torque)), rng)
    output = _draw_torque_meter(sessions, float(np.max(output_torque)), rng)
    stroke = rng.uniform(*_STROKE)
    speed = rng.uniform(*_SPEED_SCALE)
    normal = rng.standard_normal((6, sessions))
    return Meters(
        engine=engine,
        output=output,
        stroke_scale=stroke * normal[0],
        stroke_zero=stroke * normal[1],
        engine_scale=speed * normal[2],
        output_scale=speed * normal[3],
        gauge_gain=_GAUGE[0] * normal[4],
        gauge_zero=_GAUGE[1] * normal[5],
        stroke_deviation=float(stroke),
        speed_deviation=float(speed),
    )


def _draw_torque_meter(
    sessions: int, largest: float, rng: np.random.Generator
) -> TorqueMeter:
    scale = largest * rng.uniform(*_FULL_SCALE)
    zero = scale * rng.uniform(*_ZERO)
    gain = rng.uniform(*_GAIN)
    warmth = scale * rng.uniform(*_WARMTH) / 10.0
    scatter = scale * rng.uniform(*_SCATTER)
    normal = rng.standard_normal((2, sessions))
    return TorqueMeter(
        zero=zero * normal[0],
        gain=gain * normal[1],
        warmth=float(warmth * rng.standard_normal()),
        scatter=float(scatter),
        zero_deviation=float(zero),
        gain_deviation=float(gain),
        warmth_deviation=float(warmth),
    )

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Meters of the bench: two of torque with their sessions, two of speed, a gauge, a thermometer."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from studies.blind.bench.properties import Bench
from studies.blind.campaign import pressure_noise
from studies.blind.effect import FloatArray

#: Full scale against the largest torque of the campaign.
_FULL_SCALE = (1.2, 2.0)
#: Of full scale: largest zero of a session; largest drift; width of the hysteresis; standard
#: deviation of a reading.
_ZERO = (0.0005, 0.001)
_DRIFT = 0.0003
_HYSTERESIS = (0.0002, 0.0005)
_SCATTER = (0.0001, 0.0005)
#: Largest gain of a session.
_GAIN = (0.0005, 0.001)
#: Relative standard deviation of a reading of speed.
SPEED_SCATTER = 0.0002
_MAX_SESSIONS = 6


@dataclass(frozen=True)
class TorqueMeter:
    """A torque meter with what it does in each session.

    Attributes:
        full_scale: [N m].
        zeros: of each session [N m].
        gains: of each session, reading / torque - 1.
        drift: at the end of each session against its beginning [N m].
        swing: further drift that comes back within a session [N m].
        hysteresis: width between falling and rising torque [N m].
        scatter: standard deviation of a reading [N m].
        zero_sd, gain_sd: standard deviations from which zeros and gains are drawn [N m], [-].
    """

    full_scale: float
    zeros: FloatArray
    gains: FloatArray
    drift: FloatArray
    swing: FloatArray
    hysteresis: float
    scatter: float
    zero_sd: float
    gain_sd: float

    def read(
        self,
        torque: FloatArray,
        session: npt.NDArray[np.int_],
        elapsed: FloatArray,
        approach: FloatArray,
    ) -> FloatArray:
        """Return readings without scatter [N m].

        Args:
            torque: true [N m], shape (n,).
            session: number of the session.
            elapsed: part of the session that has passed, 0 to 1.
            approach: 1 where the torque rose to the test, -1 where it fell.
        """
        drift = self.drift[session] * elapsed
        drift = drift + self.swing[session] * np.sin(np.pi * elapsed)
        lag = -0.5 * self.hysteresis * approach
        gain = 1.0 + self.gains[session]
        return np.asarray(torque * gain + self.zeros[session] + drift + lag)


@dataclass(frozen=True)
class Meters:
    """All meters of one campaign.

    Attributes:
        engine, output: the torque meters.
        speed_scatter: relative, of either speed meter.
        gauge: gain - 1 and zero [Pa] of the gauge of the loop pressure.
    """

    engine: TorqueMeter
    output: TorqueMeter
    speed_scatter: float
    gauge: tuple[float, float]


def draw_meters(
    bench: Bench,
    engine_torque: FloatArray,
    output_torque: FloatArray,
    rng: np.random.Generator,
) -> Meters:
    """Draw the meters for the torques of a campaign."""
    engine = _draw_meter(bench, float(np.nanmax(engine_torque)), rng)
    output = _draw_meter(bench, float(np.nanmax(output_torque)), rng)
    gain, zero = rng.normal(0.0, (0.005, 5e4))
    speed = SPEED_SCATTER if bench.speed_noise else 0.0
    return Meters(engine, output, speed, (float(gain), float(zero)))


def _draw_meter(bench: Bench, largest: float, rng: np.random.Generator) -> TorqueMeter:
    # Everything is drawn whatever is switched off, so that the rest stays as it is.
    scale = largest * rng.uniform(*_FULL_SCALE)
    zero = scale * rng.uniform(*_ZERO)
    gain = rng.uniform(*_GAIN)
    hysteresis = scale * rng.uniform(*_HYSTERESIS)
    scatter = scale * rng.uniform(*_SCATTER)
    even = rng.uniform(-1.0, 1.0, (4, _MAX_SESSIONS))
    drift = scale * _DRIFT * even[2:]
    return TorqueMeter(
        full_scale=scale,
        zeros=zero * even[0] * bench.zero,
        gains=gain * even[1] * bench.gain,
        drift=drift[0] * bench.drift,
        swing=drift[1] * bench.drift,
        hysteresis=hysteresis * bench.hysteresis,
        scatter=scatter * bench.noise,
        zero_sd=zero / np.sqrt(3.0) * bench.zero,
        gain_sd=gain / np.sqrt(3.0) * bench.gain,
    )


def approach_of(values: FloatArray, session: npt.NDArray[np.int_]) -> FloatArray:
    """Return 1 where values rose from the test before, -1 where they fell; from rest they rise."""
    before = np.concatenate([[0.0], values[:-1]])
    first = np.concatenate([[True], session[1:] != session[:-1]])
    before = np.where(first, 0.0, before)
    return np.where(values >= before, 1.0, -1.0)


def elapsed_of(stamp: FloatArray, session: npt.NDArray[np.int_]) -> FloatArray:
    """Return which part of its session has passed at each test."""
    elapsed = np.zeros(len(stamp))
    for number in np.unique(session):
        inside = session == number
        start = np.min(stamp[inside])
        length = max(np.max(stamp[inside]) - start, 1.0)
        elapsed[inside] = (stamp[inside] - start) / length
    return elapsed


def gauge_scatter(pressure: FloatArray) -> FloatArray:
    """Return the standard deviation of a reading of the gauge [Pa]."""
    return pressure_noise(np.abs(pressure))

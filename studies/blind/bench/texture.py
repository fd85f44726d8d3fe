# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a loss table has beyond its form: a smooth random field over stroke, speed and load.

A stationary Gaussian field by random Fourier features (Rahimi and Recht, NIPS 2007): its length
scale along each axis is drawn, and no polynomial or form of a loss comes near it.
"""

from dataclasses import dataclass

import numpy as np

from studies.blind.bench.plant import BenchConditions
from studies.blind.effect import Conditions, Effect, FloatArray

_WAVES = 60
#: Length scales along each axis, in half ranges of the axis.
_LENGTHS = (0.4, 1.6)
#: Middle and half range of engine speed [rad/s] and load torque [N m].
_SPEED = (154.0, 76.0)
_LOAD = (260.0, 220.0)
#: A further loss of x P / eta^2 lowers the efficiency by x; eta about 0.8.
_EFFICIENCY = 0.8


@dataclass(frozen=True)
class Field:
    """A Gaussian field of unit variance over the cube of stroke, speed and load.

    Attributes:
        waves: wave numbers of each feature, shape (waves, 3).
        phases: shape (waves,).
    """

    waves: FloatArray
    phases: FloatArray

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "Field":
        """Draw length scales and waves."""
        low, high = np.log(_LENGTHS)
        lengths = np.exp(rng.uniform(low, high, 3))
        waves = rng.standard_normal((_WAVES, 3)) / lengths
        return cls(waves, rng.uniform(0.0, 2.0 * np.pi, _WAVES))

    @classmethod
    def even(cls) -> "Field":
        """Return the field that is one everywhere."""
        # Two waves of amplitude one, each at half its height.
        return cls(np.zeros((2, 3)), np.full(2, np.pi / 3.0))

    def features(
        self, stroke: FloatArray, speed: FloatArray, load: FloatArray
    ) -> FloatArray:
        """Return the features, shape (..., waves); their squares sum to one on average."""
        axes = (
            stroke,
            (speed - _SPEED[0]) / _SPEED[1],
            (load - _LOAD[0]) / _LOAD[1],
        )
        angle = np.stack(np.broadcast_arrays(*axes), axis=-1) @ self.waves.T
        return np.asarray(np.sqrt(2.0 / len(self.phases)) * np.cos(angle + self.phases))

    def values(
        self, stroke: FloatArray, speed: FloatArray, load: FloatArray
    ) -> FloatArray:
        """Return the field, shape (...)."""
        return np.asarray(np.sum(self.features(stroke, speed, load), axis=-1))


@dataclass(frozen=True)
class Texture(Effect):
    """Loss of torque and of flow beyond the form of the base.

    Attributes:
        size: root mean square in efficiency [-].
        torque: field of the torque lost.
        flow: field of the flow lost.
        flow_share: size of the second against the first.
    """

    torque: Field | None = None
    flow: Field | None = None
    flow_share: float = 0.3

    def engine_drag_power(self, at: Conditions) -> FloatArray:
        if self.torque is None or not isinstance(at, BenchConditions):
            return np.zeros_like(at.pressure)
        power = at.load_power / _EFFICIENCY**2
        return np.asarray(self.size * power * _values(self.torque, at))

    def lost_flow(self, at: Conditions) -> FloatArray:
        if self.flow is None:
            return np.zeros_like(at.pressure)
        flow = self.flow_share * at.pump_displacement * at.pump_speed
        return np.asarray(self.size * flow * _values(self.flow, at))


def draw_texture(amplitude: float, rng: np.random.Generator) -> Texture:
    """Draw a texture of a root mean square in efficiency."""
    share = float(rng.uniform(0.0, 0.6))
    return Texture(amplitude, "", Field.drawn(rng), Field.drawn(rng), share)


def _values(field: Field, at: Conditions) -> FloatArray:
    return field.values(at.command, at.engine_speed, at.load_torque)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a bench reads: one function for each channel of the registry, under its name."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ..transmission.ranges import Array, Solution
from .effects.base import Effect
from .shafts import PowerFlow, Shafts


class BenchState(NamedTuple):
    """Steady state of a transmission at points of a bench; arrays of shape (..., n).

    Attributes:
        shafts: constants at the points.
        flow: speeds, torques, pressure and powers.
        true: efficiency, output speed and engine torque without the errors of meters.
        effects: of powers and of meters.
    """

    shafts: Shafts
    flow: PowerFlow
    true: Solution
    effects: Sequence[Effect]


def efficiency(bench: BenchState) -> Array:
    """Return output power / engine power as read [-]."""
    read = bench.true.efficiency
    for effect in bench.effects:
        read = effect.reading(read, bench.flow.state)
    return read


def output_speed(bench: BenchState) -> Array:
    """Return the output speed as read [rad/s]."""
    read = bench.true.output_speed
    for effect in bench.effects:
        read = effect.output_speed_reading(read)
    return read


def pressure(bench: BenchState) -> Array:
    """Return the pressure over the motor as read, eq. (14) [Pa]; its sign is that of the output."""
    read = bench.shafts.senses.output * bench.flow.state.pressure
    for effect in bench.effects:
        read = effect.pressure_reading(read)
    return read


READINGS: Mapping[str, Callable[[BenchState], Array]] = {
    "efficiency": efficiency,
    "output_speed": output_speed,
    "pressure": pressure,
}
"""How each quantity of the registry with a `channel` is predicted."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Steady points of one pump or motor, with the deviations of their meters."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...model.measured_unit import KINDS as KINDS
from ...transmission.ranges import Array

METER_DEVIATION = 0.0034
"""Standard deviation of a flow or torque against the ideal one, as a part, where none is stated.

ISO 4409, class A: errors up to 0.5 % of each reading, three deviations. Four readings are in it:
flow and speed, or torque and pressure, and those two by which the displacement was found.
"""
_GAUGE_DEVIATION = 5e4  # Pa; the same class near zero, as of a transmission's pressure
LOSSES = ("flow_loss", "torque_loss")
"""The two losses that a bench for units measures."""
READ_CHANNELS = ("flow_loss", "torque_loss", "drain_flow", "electric_power")
"""Quantities that a bench may read, the one in which a gap is measured first."""
MIN_TORQUE_PRESSURE = 1e5
"""Pressure below which a mechanical efficiency determines no torque [Pa]."""


@dataclass(frozen=True, eq=False)
class UnitSamples:
    """Steady points of one pump or motor; every array has shape (n,).

    Attributes:
        kind: `pump` or `motor`.
        displacement: of full stroke, by which the losses are reckoned [m3/rad].
        displacement_ratio, speed, pressure: [-], [rad/s], [Pa] between the ports.
        flow_loss: what a pump does not deliver or a motor takes too much [m3/s], or None where no
            flow is read.
        torque_loss: what a pump takes too much or a motor does not give [N m], or None where no
            torque is read.
        oil_temperature: [deg C], or None.
        noise: standard deviation of flow and torque, as a part, or None for `METER_DEVIATION`.
        source, sha256: of the file.
        drain_flow: from the case to the tank [m3/s], or None.
        electric_power: of the motor that drives a pump [W], or None.
        notes: what was concluded on reading the file.
    """

    kind: str
    displacement: float
    displacement_ratio: Array
    speed: Array
    pressure: Array
    flow_loss: Array | None
    torque_loss: Array | None
    oil_temperature: Array | None = None
    noise: float | None = None
    source: str = "samples"
    sha256: str = ""
    drain_flow: Array | None = None
    electric_power: Array | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.speed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the quantities read, in the order of `READ_CHANNELS`."""
        return tuple(name for name in READ_CHANNELS if getattr(self, name) is not None)

    @property
    def losses(self) -> Array:
        """Loss of flow and of torque, shape (2, n).

        Raises:
            InputError: one of them is not read.
        """
        for name, loss in (("flow", self.flow_loss), ("torque", self.torque_loss)):
            if loss is None:
                raise InputError(
                    f"{self.source}: no {name} is read, nor a loss or an efficiency that gives it"
                )
        return np.stack([self.flow_loss, self.torque_loss])  # type: ignore[list-item]

    @property
    def ideal(self) -> Array:
        """Flow [m3/s] and torque [N m] without any loss, shape (2, n)."""
        return (
            self.displacement
            * self.displacement_ratio
            * np.stack([self.speed, self.pressure])
        )

    @property
    def deviation(self) -> Array:
        """Standard deviation of `losses`: that of what the meters read, shape (2, n)."""
        return np.stack([self.deviation_of(name) for name in LOSSES])

    def deviation_of(self, channel: str) -> Array:
        """Return the standard deviation of a channel: that of what the meters read, shape (n,).

        Args:
            channel: one of `channels`.
        """
        part = METER_DEVIATION if self.noise is None else self.noise
        reading = np.abs(self.meter_reading(channel))
        if channel == "torque_loss":
            gauge = _GAUGE_DEVIATION / np.maximum(self.pressure, 1.0)
            return np.asarray(np.hypot(part, gauge) * reading)
        return np.asarray(part * reading)

    def meter_reading(self, channel: str) -> Array:
        """Return what the meter of a channel reads, the loss no longer taken off, shape (n,).

        Args:
            channel: one of `channels`.
        """
        values = np.asarray(getattr(self, channel))
        ideal_flow, ideal_torque = self.ideal
        if channel == "flow_loss":
            return np.asarray(ideal_flow - sign_of(self.kind) * values)
        if channel == "torque_loss":
            return np.asarray(ideal_torque + sign_of(self.kind) * values)
        return values

    def select(self, index: NDArray[Any]) -> UnitSamples:
        """Return the samples at an index array or mask, in that order."""
        chosen: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                chosen[item.name] = value[index]
        return replace(self, **chosen)

    def divided(self, axis: str, part: float) -> tuple[UnitSamples, UnitSamples]:
        """Return the samples up to a part of the highest value along an axis, and those above.

        Raises:
            InputError: none lies above, or none that determines a torque below.
        """
        values = getattr(self, axis)
        above = values > part * values.max()
        if (
            not above.any()
            or self.pressure[~above].max(initial=0.0) < MIN_TORQUE_PRESSURE
        ):
            raise InputError(
                f"{self.source}: {part:g} of the highest {axis} parts no samples"
            )
        return self.select(~above), self.select(above)


def sign_of(kind: str) -> float:
    """1 for a pump, -1 for a motor, whose power goes the other way."""
    return 1.0 if kind == "pump" else -1.0

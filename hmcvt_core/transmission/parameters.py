# SPDX-License-Identifier: Apache-2.0
"""The three hydraulic parameters that bench samples identify."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields

import numpy as np
from numpy.typing import NDArray

from .ranges import Range

LEAKAGE = Range("leakage", 1e-16, 1e-8, "m3/(s Pa)")
MOTOR_DAMPING = Range("motor_damping", 0.0, 10.0, "N m s/rad")
PUMP_DAMPING = Range("pump_damping", 0.0, 10.0, "N m s/rad")


@dataclass(frozen=True)
class HydraulicParameters:
    """The parameters to be identified (paper, end of section 3).

    Attributes:
        leakage: C_s (V_p + V_m) / mu, leakage flow per pressure [m3/(s Pa)].
        motor_damping: f_m, viscous torque per motor speed [N m s/rad].
        pump_damping: f_p, viscous torque per pump speed [N m s/rad].

    Raises:
        InputError: a value is out of its range.
    """

    leakage: float
    motor_damping: float
    pump_damping: float

    def __post_init__(self) -> None:
        for limits in (LEAKAGE, MOTOR_DAMPING, PUMP_DAMPING):
            limits.check(getattr(self, limits.name), "parameters")

    def to_array(self) -> NDArray[np.float64]:
        """Return (leakage, motor_damping, pump_damping), shape (3,)."""
        return np.array(astuple(self))


PARAMETER_NAMES = tuple(field.name for field in fields(HydraulicParameters))
PARAMETER_UNITS = {limits.name: limits.unit for limits in (LEAKAGE, MOTOR_DAMPING, PUMP_DAMPING)}

PAPER_PARAMETERS = {
    0.98: HydraulicParameters(4.67e-12, 0.0333, 0.5613),
    0.97: HydraulicParameters(2.43e-12, 0.0311, 0.2934),
}
"""The triples printed in section 4.2, by gear efficiency. They do not reproduce Table 4."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Gear data of stage HM4 and the speeds and torques that its gear train imposes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from studies.blind.effect import FloatArray

#: 55 cm3 per revolution; the paper does not publish it, so it is assumed.
DISPLACEMENT_PER_RADIAN = 55e-6 / (2.0 * 3.141592653589793)


#: Gear pairs (Table 1, figure 1): mechanical path 2, 3; pump 4; motor 5; output 6, 11.
_TABLE_1 = {2: 0.969, 3: 1.484, 4: 0.678, 5: 1.96, 6: 0.982, 11: 0.823}


@dataclass(frozen=True)
class GearTrain:
    """Stage HM4 (Table 1) with its pump and motor.

    `ratios` are driving speed / driven speed of each pair in the direction engine to output;
    `k1` is ring teeth / sun teeth; displacements are m3/rad; inertias (kg m2) are those given
    below eq. (15); `engine_inertia` is that of the engine at the pump shaft, `load_inertia`
    that of the dynamometer at the motor shaft; `oil_volume` (m3) and `bulk_modulus` (Pa) are V0
    and beta_e of eq. (13). These four are assumed; no steady state depends on them.
    """

    ratios: Mapping[int, float] = field(default_factory=lambda: _TABLE_1)
    k1: float = 2.56
    gear_efficiency: float = 0.98
    pump_displacement: float = DISPLACEMENT_PER_RADIAN
    motor_displacement: float = DISPLACEMENT_PER_RADIAN
    pump_inertia: float = 0.0054
    motor_inertia: float = 0.0049
    engine_inertia: float = 0.5
    load_inertia: float = 0.06
    oil_volume: float = 8e-4
    bulk_modulus: float = 1.3e9

    def carrier_speed(self, engine_speed: FloatArray) -> FloatArray:
        """Speed of the planet carrier, rad/s."""
        return engine_speed / (self.ratios[2] * self.ratios[3])

    def ring_speed(self, carrier_speed: FloatArray, motor_speed: FloatArray) -> FloatArray:
        """Eq. (4); the motor turns the sun against the carrier, so it adds, as in eq. (5)."""
        sun = motor_speed / self.ratios[5]
        return ((1.0 + self.k1) * carrier_speed + sun) / self.k1

    def output_speed(self, ring_speed: FloatArray) -> FloatArray:
        """Speed of the output shaft, rad/s."""
        return ring_speed / (self.ratios[6] * self.ratios[11])

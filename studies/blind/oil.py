# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Viscosity of the oil against temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from studies.blind.effect import Effect, FloatArray, between

#: Temperature at which the base parameters hold, deg C.
NOMINAL_TEMPERATURE = 60.0
#: lg lg(nu + 0.7) at 40 and 100 deg C of a tractor transmission oil with 60 and 9.5 mm2/s there.
_COOL, _HOT = np.log10(np.log10(np.array([60.0, 9.5]) + 0.7))
_STEEPNESS = (_COOL - _HOT) / np.log10(373.15 / 313.15)


def relative_viscosity(temperature: FloatArray, slope: float = 1.0) -> FloatArray:
    """Kinematic viscosity over that at 60 deg C; shape as `temperature` (deg C).

    Walther's equation (ASTM D341): lg lg(nu + 0.7) falls linearly with lg T. `slope` scales the
    fall: below 1 an oil of higher viscosity index.
    """
    nominal = NOMINAL_TEMPERATURE + 273.15
    level = _COOL - _STEEPNESS * np.log10(nominal / 313.15)
    drop = slope * _STEEPNESS * np.log10((temperature + 273.15) / nominal)
    return np.asarray((10.0 ** 10.0 ** (level - drop) - 0.7) / (10.0 ** 10.0**level - 0.7))


@dataclass(frozen=True)
class OilTemperature(Effect):
    """Viscosity follows the oil's temperature in gaps and in films.

    Gaps carry loop oil and follow the sump fully; films are cooled by the casing and follow it
    by `film_share`. `size` scales the slope of Walther's line.
    """

    limit: ClassVar[float] = 1.5
    film_share: float = between(0.6, 1.0)

    def gap_viscosity(self, oil_temperature: FloatArray) -> FloatArray:
        return relative_viscosity(oil_temperature, self.size)

    def film_viscosity(self, oil_temperature: FloatArray) -> FloatArray:
        moved = NOMINAL_TEMPERATURE + self.film_share * (oil_temperature - NOMINAL_TEMPERATURE)
        return relative_viscosity(moved, self.size)

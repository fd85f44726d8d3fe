# SPDX-License-Identifier: Apache-2.0
"""Oil temperature: viscosity moves leakage (1/mu) and damping (mu)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .base import Array, Effect, Value, size

_REFERENCE = 60.0  # deg C, viscosity ratio 1
_KELVIN = 273.15
_VG46 = (46.0, 6.8)  # mm2/s at 40 and 100 deg C


def walther_log_viscosity(oil_temperature: Array) -> Array:
    """ln of the kinematic viscosity of an ISO VG 46 oil, Walther (ASTM D341) [ln(mm2/s)]."""
    warm, hot = (np.log10(np.log10(value + 0.7)) for value in _VG46)
    slope = (warm - hot) / np.log10((100.0 + _KELVIN) / (40.0 + _KELVIN))
    level = warm + slope * np.log10(40.0 + _KELVIN)
    double = level - slope * np.log10(np.asarray(oil_temperature) + _KELVIN)
    return np.asarray(np.log(10.0 ** (10.0**double) - 0.7))


@dataclass(frozen=True)
class OilTemperature(Effect):
    """mu / mu_60 = (Walther ratio of VG 46)^strength; 1 is such an oil, 0 no dependence."""

    name = "oil_temperature"
    component = "oil"
    summary = "oil temperature changes viscosity: hot oil leaks more and damps less"
    source = "Walther / ASTM D341"
    remedy = "log the oil temperature and sweep it"

    strength: float = size("-", 1.0, 0.0, 2.5, "sensitivity / that of an ISO VG 46 oil")

    def viscosity_ratio(self, oil_temperature: Array) -> Value:
        """See `Effect`."""
        change = (walther_log_viscosity(oil_temperature)
                  - walther_log_viscosity(np.array(_REFERENCE)))
        return np.asarray(np.exp(self.strength * change))

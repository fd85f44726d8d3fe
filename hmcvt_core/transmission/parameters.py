# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The three hydraulic parameters that bench samples identify."""

from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .quantities import PAPER_EFFICIENCY_UNCERTAINTY as PAPER_EFFICIENCY_UNCERTAINTY
from .quantities import Range

PARAMETER_RANGES = (
    Range("leakage", 1e-16, 1e-8, "m3/(s Pa)"),
    Range("motor_damping", 0.0, 10.0, "N m s/rad"),
    Range("pump_damping", 0.0, 10.0, "N m s/rad"),
)
PARAMETER_NAMES = tuple(limits.name for limits in PARAMETER_RANGES)
PARAMETER_UNITS = {limits.name: limits.unit for limits in PARAMETER_RANGES}


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
        for limits in PARAMETER_RANGES:
            limits.check(getattr(self, limits.name), "parameters")

    def to_array(self) -> NDArray[np.float64]:
        """Return (leakage, motor_damping, pump_damping), shape (3,)."""
        return np.array(astuple(self))

    def to_mapping(
        self, standard_errors: Mapping[str, float]
    ) -> dict[str, dict[str, Any]]:
        """Return value, unit and, where it is known, standard error of each by name."""
        entries = {}
        for name in PARAMETER_NAMES:
            entry = {"value": getattr(self, name), "unit": PARAMETER_UNITS[name]}
            if name in standard_errors:
                entry["standard_error"] = float(standard_errors[name])
            entries[name] = entry
        return entries


class Candidates(NamedTuple):
    """Parameters of many candidates at once; arrays that broadcast with the points."""

    leakage: NDArray[np.float64] | float
    motor_damping: NDArray[np.float64] | float
    pump_damping: NDArray[np.float64] | float


Parameters = HydraulicParameters | Candidates
"""What the physics reads: one transmission, or many candidates for it."""

# Searches and refits work in scaled variables: log10 of the leakage, which spans decades; the
# dampings as they are, so that zero can be reached.
SEARCH_BOUNDS = np.array([[-13.0, -10.0], [0.0, 1.0], [0.0, 1.5]])
"""Limits within which the identification searches, in scaled variables, shape (3, 2)."""

PRIOR_MEAN = np.array([-10.8, 0.15, 0.20])
PRIOR_SPREAD = np.array([0.6, 0.25, 0.40])
"""Mean and standard deviation of the scaled variables before any bench: wide, physical."""


def to_scaled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return scaled variables of parameters (leakage, f_m, f_p), shape (..., 3)."""
    scaled = np.array(values, dtype=float)
    scaled[..., 0] = np.log10(scaled[..., 0])
    return scaled


def from_scaled(scaled: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return parameters (leakage, f_m, f_p) of scaled variables, shape (..., 3)."""
    values = np.array(scaled, dtype=float)
    # Not **: NumPy 1.26 rounds 1e-10 down.
    values[..., 0] = np.float_power(10.0, values[..., 0])
    return values


PAPER_PARAMETERS = {
    0.98: HydraulicParameters(4.67e-12, 0.0333, 0.5613),
    0.97: HydraulicParameters(2.43e-12, 0.0311, 0.2934),
}
"""The triples printed in section 4.2, by gear efficiency. They do not reproduce Table 4."""


TYPICAL_PARAMETERS = HydraulicParameters(*from_scaled(PRIOR_MEAN).tolist())
"""Parameters expected before any bench."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Base parameters of a transmission bench: hydraulics, gear loss, and gain and zero of the gauge.

Refits work in scaled variables: the hydraulic parameters as the identification scales them, the
others in units of their tolerance.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...diagnosis.system import Array, BaseParameters
from ...transmission.parameters import (
    PARAMETER_NAMES,
    PARAMETER_RANGES,
    PARAMETER_UNITS,
    PRIOR_MEAN,
    PRIOR_SPREAD,
    HydraulicParameters,
    from_scaled,
    to_scaled,
)

GEAR_LOSS_TOLERANCE = 0.0006
"""Standard deviation of the further power fraction lost in each gear pair [-].

Scatter of production 0.0005; the systematic gain of the torque meters, 0.12 % (paper, section 2.2),
has the same signature.
"""
PRESSURE_GAIN_TOLERANCE = 0.01
"""Standard deviation of the relative error of gauge and displacement [-] (ISO 4409, ISO 8426)."""
PRESSURE_ZERO_TOLERANCE = 1e5
"""Standard deviation of the zero error of the gauge [Pa]."""
LARGEST_DEVIATION = 6.0
"""Bound on these three, in tolerances: beyond it the machine is a different one."""

_TOLERANCES = {
    "gear_loss": GEAR_LOSS_TOLERANCE,
    "pressure_gain": PRESSURE_GAIN_TOLERANCE,
    "pressure_zero": PRESSURE_ZERO_TOLERANCE,
}

UNITS = {"gear_loss": "-", "pressure_gain": "-", "pressure_zero": "Pa"}
"""Units of the base parameters that are no hydraulic parameters."""


@dataclass(frozen=True)
class BaseValues:
    """Base parameters in their units.

    Attributes:
        hydraulics: the three identified parameters.
        gear_loss: further fraction of the power lost in each gear pair [-].
        pressure_gain: relative error of the pressure reading [-].
        pressure_zero: zero error of the pressure reading [Pa].
    """

    hydraulics: HydraulicParameters
    gear_loss: float
    pressure_gain: float = 0.0
    pressure_zero: float = 0.0


def base_parameters(pressure: bool) -> BaseParameters:
    """Return names, priors and bounds of the base parameters.

    Args:
        pressure: whether the bench reads the pressure, so that its gauge is refitted too.
    """
    tolerances = dict(_TOLERANCES)
    if not pressure:
        tolerances = {"gear_loss": GEAR_LOSS_TOLERANCE}
    scales = np.array(list(tolerances.values()))
    ones = np.ones(len(scales))
    lowest = to_scaled(np.array([limits.low for limits in PARAMETER_RANGES]))
    highest = to_scaled(np.array([limits.high for limits in PARAMETER_RANGES]))
    return BaseParameters(
        names=(*PARAMETER_NAMES, *tolerances),
        mean=np.append(PRIOR_MEAN, 0.0 * ones),
        spread=np.append(PRIOR_SPREAD, ones),
        low=np.append(lowest, -LARGEST_DEVIATION * ones),
        high=np.append(highest, LARGEST_DEVIATION * ones),
        values=partial(_values, scales=scales),
        units=(*PARAMETER_UNITS.values(), *(UNITS[name] for name in tolerances)),
    )


def _values(scaled: Array, scales: Array) -> Array:
    """Return the parameters in their units: the hydraulic ones, then scaled tolerances."""
    count = len(PARAMETER_NAMES)
    return np.append(from_scaled(scaled[:count]), scales * np.asarray(scaled[count:]))


def base_values(parameters: BaseParameters, scaled: Array) -> BaseValues:
    """Return the base parameters of scaled variables by name.

    Args:
        parameters: as of `base_parameters`.
        scaled: scaled variables, shape (p,).
    """
    named = dict(zip(parameters.names, parameters.values(scaled).tolist(), strict=True))
    hydraulics = HydraulicParameters(
        **{name: named.pop(name) for name in PARAMETER_NAMES}
    )
    return BaseValues(hydraulics, **named)


def scaled_base(parameters: BaseParameters, hydraulics: HydraulicParameters) -> Array:
    """Return scaled variables of a model whose gears and gauge are as stated, shape (p,)."""
    scaled = np.zeros(len(parameters))
    scaled[: len(PARAMETER_NAMES)] = to_scaled(hydraulics.to_array())
    return scaled


def hydraulic_errors(
    scaled: Array, covariance: Array
) -> tuple[dict[str, float], Array]:
    """Return standard errors of the hydraulic parameters, linearised, and their correlation.

    Args:
        scaled: scaled base parameters, shape (p,).
        covariance: of the scaled base parameters, shape (p, p).

    Returns:
        Standard errors by name, each in the unit of its parameter, and the correlation of the
        scaled parameters, shape (3, 3).
    """
    count = len(PARAMETER_NAMES)
    part = covariance[:count, :count]
    spread = np.sqrt(np.diag(part))
    errors = dict(zip(PARAMETER_NAMES, spread.tolist(), strict=True))
    leakage = float(from_scaled(scaled[:count])[0])
    errors["leakage"] *= np.log(10.0) * leakage  # the scaled variable is its logarithm
    return errors, part / np.outer(spread, spread)

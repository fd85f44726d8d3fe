# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Base parameters of a transmission bench: hydraulics, gear loss, and errors of the gauges.

Refits work in scaled variables: the hydraulic parameters as the identification scales them, the
others in units of their tolerance.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

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
from ...transmission.quantities import PREDICTED, Quantity

GEAR_LOSS_TOLERANCE = 0.0006
"""Standard deviation of the further power fraction lost in each gear pair [-].

Scatter of production 0.0005; the systematic gain of the torque meters, 0.12 % (paper, section 2.2),
has the same signature.
"""
LARGEST_DEVIATION = 6.0
"""Bound on gear loss and gauges, in tolerances: beyond it the machine is a different one."""


class GaugeError(NamedTuple):
    """An error of what reads a channel.

    Attributes:
        name: `<channel>_gain` or `<channel>_zero`.
        words: for reports.
        channel: that is read.
        is_zero: whether it adds to the reading, instead of being in proportion to it.
        deviation: prior standard deviation, in `unit`.
        unit: `-`, or that of the channel.
        by_session: whether it differs from session to session.
    """

    name: str
    words: str
    channel: str
    is_zero: bool
    deviation: float
    unit: str
    by_session: bool

    def change_at(self, reading: Array) -> Array:
        """Return the change of readings by an error of 1, of the same shape."""
        return np.ones_like(reading) if self.is_zero else reading


def gauge_errors(
    names: Collection[str], quantities: Sequence[Quantity] = PREDICTED
) -> list[GaugeError]:
    """Return the errors of what reads some quantities, in the order of the registry.

    Args:
        names: of the quantities that are read.
        quantities: to choose from.
    """
    errors = []
    for quantity in quantities:
        gauge = quantity.gauge
        if gauge is None or quantity.name not in names:
            continue
        for kind, deviation in (("gain", gauge.gain), ("zero", gauge.zero)):
            if deviation:
                errors.append(
                    GaugeError(
                        name=f"{quantity.name}_{kind}",
                        words=f"{kind} of the {gauge.name}",
                        channel=quantity.name,
                        is_zero=kind == "zero",
                        deviation=deviation,
                        unit=quantity.unit if kind == "zero" else "-",
                        by_session=gauge.by_session,
                    )
                )
    return errors


def refitted_errors(channels: Collection[str]) -> list[GaugeError]:
    """Return those of the errors that every fit adjusts."""
    return [error for error in gauge_errors(channels) if not error.by_session]


@dataclass(frozen=True)
class BaseValues:
    """Base parameters in their units.

    Attributes:
        hydraulics: the three identified parameters.
        gear_loss: further fraction of the power lost in each gear pair [-].
        gauges: errors of gauges by the name of the parameter, see `refitted_errors`.
    """

    hydraulics: HydraulicParameters
    gear_loss: float
    gauges: Mapping[str, float]


def base_parameters(channels: Collection[str]) -> BaseParameters:
    """Return names, priors and bounds of the base parameters.

    Args:
        channels: that the bench reads, so that their gauges are refitted too.
    """
    gauges = refitted_errors(channels)
    scales = np.array([GEAR_LOSS_TOLERANCE, *(error.deviation for error in gauges)])
    ones = np.ones(len(scales))
    lowest = to_scaled(np.array([limits.low for limits in PARAMETER_RANGES]))
    highest = to_scaled(np.array([limits.high for limits in PARAMETER_RANGES]))
    return BaseParameters(
        names=(*PARAMETER_NAMES, "gear_loss", *(error.name for error in gauges)),
        mean=np.append(PRIOR_MEAN, 0.0 * ones),
        spread=np.append(PRIOR_SPREAD, ones),
        low=np.append(lowest, -LARGEST_DEVIATION * ones),
        high=np.append(highest, LARGEST_DEVIATION * ones),
        values=partial(_values, scales=scales),
        units=(*PARAMETER_UNITS.values(), "-", *(error.unit for error in gauges)),
    )


def _values(scaled: Array, scales: Array) -> Array:
    """Return the parameters in their units: the hydraulic ones, then scaled tolerances."""
    count = len(PARAMETER_NAMES)
    tolerances = scales * np.asarray(scaled[count:])
    return np.concatenate([from_scaled(scaled[:count]), tolerances])


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
    return BaseValues(hydraulics, named.pop("gear_loss"), named)


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

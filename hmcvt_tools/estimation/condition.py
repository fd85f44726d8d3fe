# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a machine differs in from the one identified: temperature of the oil, and wear.

Leakage follows the reciprocal of the viscosity, the dampings its power between those of rolling
and of full films (as effect `oil_temperature`). The load moves in proportion to the parameters, to
first order; an oil of another grade or a separate film is what the widening stands for.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.physics.effects.base import OIL_HOOKS
from hmcvt_core.physics.effects.hydraulic import walther_log_viscosity
from hmcvt_core.transmission.parameters import PARAMETER_NAMES
from hmcvt_core.transmission.ranges import OIL_TEMPERATURE, Array

from .settings import EstimateSettings
from .solving import Solved

_FILM_EXPONENT = 0.835
"""Power of the viscosity in the dampings: middle of 0.67 (rolling) and 1 (full films)."""
_OIL_ERROR = 0.5
"""Standard deviation of a move by the oil, as a part of it; wide: grade and films are unknown."""
OIL_SLACK = 5.0
"""By which the oil may be off the identified temperatures before it counts as outside [deg C]."""


class Moves(NamedTuple):
    """Changes of the load torque [N m], shape (n,) each, 0 where nothing is known.

    Attributes:
        load: by which it moves.
        wear_deviation: standard deviation that wear leaves, with its sign.
        oil_deviation: standard deviation that the oil leaves, with its sign.
    """

    load: Array
    wear_deviation: Array
    oil_deviation: Array


def identified_temperatures(
    model: EfficiencyModel, settings: EstimateSettings
) -> tuple[float, float] | None:
    """Return lowest and highest oil temperature of the identification [deg C], None if unknown."""
    if settings.oil_temperature is not None:
        return settings.oil_temperature, settings.oil_temperature
    stated = model.provenance.get("oil_temperature")
    if not (isinstance(stated, list | tuple) and len(stated) == 2):
        return None
    low, high = stated
    if not (isinstance(low, int | float) and isinstance(high, int | float)):
        return None
    if not OIL_TEMPERATURE.contains([low, high]).all():
        return None
    return float(low), float(high)


def follows_viscosity(model: EfficiencyModel) -> bool:
    """Whether an effect of a model already moves leakage and dampings with the oil."""
    return any(effect.acts_at(*OIL_HOOKS) for effect in model.effects)


def moves(
    model: EfficiencyModel,
    solved: Solved,
    oil_temperature: Array | None,
    settings: EstimateSettings,
) -> Moves:
    """Return how the condition of a machine moves its load.

    Args:
        model: states errors of its parameters, else nothing moves.
        solved: loads, and their change by one standard error of each parameter.
        oil_temperature: of the log [deg C], shape (n,), NaN where not known; None without a signal.
            It moves nothing where an effect of the model has already read it.
        settings: wear, and the temperature of the identification.
    """
    count = len(solved.load_torque)
    nothing = np.zeros(count)
    if not model.states_errors:
        return Moves(nothing, nothing, nothing)
    by_part = []
    for name, change in zip(PARAMETER_NAMES, solved.parameter_change, strict=True):
        error = model.standard_errors[name]
        # Change of the load where the parameter doubles.
        doubled = getattr(model.parameters, name) / error if error > 0.0 else 0.0
        by_part.append(np.nan_to_num(change) * doubled)
    leakage, motor, pump = by_part
    worn = 0.5 * settings.wear * leakage
    oil = nothing
    temperatures = identified_temperatures(model, settings)
    if follows_viscosity(model):
        oil_temperature = None
    if oil_temperature is not None and temperatures is not None:
        reference = np.array(0.5 * sum(temperatures))
        known = OIL_TEMPERATURE.contains(oil_temperature)
        at = np.where(known, oil_temperature, reference)
        change = walther_log_viscosity(at) - walther_log_viscosity(reference)
        thicker = np.exp(_FILM_EXPONENT * change) - 1.0
        oil = (np.exp(-change) - 1.0) * leakage + thicker * (motor + pump)
    return Moves(worn + oil, worn, _OIL_ERROR * oil)


def outside_identified(
    oil_temperature: Array, temperatures: tuple[float, float]
) -> Array:
    """Return where the oil is outside the temperatures of the identification, shape (n,), bool."""
    low, high = temperatures
    colder = oil_temperature < low - OIL_SLACK
    return np.asarray(colder | (oil_temperature > high + OIL_SLACK))

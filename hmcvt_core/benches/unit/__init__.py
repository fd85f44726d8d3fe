# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One pump or motor on a bench: its loss model, its diagnosis, and its transfer into a model.

samples    steady points with the deviations of their meters
system     the loss terms of the paper as a `System`
diagnosis  the gap to these terms
served     the model that is saved
change     diagnosis of a change since the unit was `sound`
transfer   its losses, put into the model of a transmission
"""

from .change import UnitChange, diagnose_change
from .diagnosis import DEALS, UnitDiagnosis, diagnose_unit
from .system import (
    CHANNEL_UNITS,
    FRICTION,
    PARAMETERS,
    PRESSURE,
    SPEED,
    STROKE,
    HydrostaticUnit,
    UnitModel,
    observe_unit,
)
from .transfer import put_into

__all__ = [
    "CHANNEL_UNITS",
    "DEALS",
    "FRICTION",
    "PARAMETERS",
    "PRESSURE",
    "SPEED",
    "STROKE",
    "HydrostaticUnit",
    "UnitChange",
    "UnitDiagnosis",
    "UnitModel",
    "diagnose_change",
    "diagnose_unit",
    "observe_unit",
    "put_into",
]

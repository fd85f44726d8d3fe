# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One pump or motor on a bench: its loss model, its diagnosis, and its transfer into a model."""

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

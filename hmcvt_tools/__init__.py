# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Data in and results out of `hmcvt_core`: commands, tables and logs, reports, exports, missions.

cli         the command `hmcvt`
study       from a bench table and the gears to model, cause, next test and code
report      pages and pictures of results
export      the model as C, as an FMU, as maps for MATLAB, as a page that computes
fleet       many logs in parallel
mission     fuel over a work cycle: strategies, and the least possible
estimation  output power, losses and drift from the bus of a machine
logs        MDF4, TDMS and CAN traces in, bench samples out
tables      tables of any form in, bench samples out
fmu_function  an FMU as a function of operating points
steady      steady windows of momentary readings

The names below keep their meaning within a minor version, as those of `hmcvt_core` do.
"""

from hmcvt_core.transmission.units import UNITS

from .estimation import Estimate, EstimateSettings, estimate
from .export import export_c, export_fmu, export_mat, write_page
from .fleet import ONE_BLAS_THREAD
from .fmu_function import FmuFunction
from .mission import Drive, Vehicle, load_vehicle
from .mission.controller import Controller
from .report import write_html
from .steady import (
    SETTLED,
    Readings,
    Shafts,
    Steadiness,
    SteadyWindow,
    block_statistics,
    channels,
    complaint,
    held,
    limit,
    require_positive,
    split_at_gaps,
    steady_tests,
)
from .tables.raw import read_raw_bench
from .tables.unit_table import read_unit

__all__ = [
    "ONE_BLAS_THREAD",
    "SETTLED",
    "UNITS",
    "Controller",
    "Drive",
    "Estimate",
    "EstimateSettings",
    "FmuFunction",
    "Readings",
    "Shafts",
    "Steadiness",
    "SteadyWindow",
    "Vehicle",
    "block_statistics",
    "channels",
    "complaint",
    "estimate",
    "export_c",
    "export_fmu",
    "export_mat",
    "held",
    "limit",
    "load_vehicle",
    "read_raw_bench",
    "read_unit",
    "require_positive",
    "split_at_gaps",
    "steady_tests",
    "write_html",
    "write_page",
]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Recordings of machines: MDF4, TDMS and CAN traces as streams of signals, and joined in time.

A log gives its signals in pieces (`series`), so that a file may be larger than the memory.

opening     chooses the reader of a file
mdf, tdms   readers of MDF4 and TDMS; `grouped`: channels of one name in several groups
bus         reader of CAN traces: frames of `can_files`, decoded by `j1939` and `dbc` (`signals`)
joining     signals of different rates on one time axis
selection   which channels hold which quantities, in SI units
log_import  the steady parts as bench samples
"""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Recordings of machines: MDF4, TDMS and CAN traces as streams of signals, and joined in time.

A log gives its signals in pieces (`Log.pieces`), so that a file may be larger than the memory. The
readers are `mdf`, `tdms` and `bus`; `opening` chooses one. `joining` brings signals of different
rates to one time axis, and `selection` turns channels into quantities in SI units. `log_import`
cuts the steady parts into bench samples.
"""

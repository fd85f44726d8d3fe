# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification of the hydraulic parameters from bench samples."""

from .annealing import Schedule
from .identify import identify
from .result import Identification

__all__ = ["Identification", "Schedule", "identify"]

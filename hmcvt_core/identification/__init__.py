# SPDX-License-Identifier: Apache-2.0
"""Identification of the hydraulic parameters from bench samples."""

from .identify import Identification, identify, identify_gear_efficiency

__all__ = ["Identification", "identify", "identify_gear_efficiency"]

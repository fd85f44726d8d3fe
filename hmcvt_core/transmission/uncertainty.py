# SPDX-License-Identifier: Apache-2.0
"""Measurement uncertainty of a bench; `studies/reproduce` works it out by eqs (1)-(3)."""

PAPER_EFFICIENCY_UNCERTAINTY = 0.0112
"""Total relative uncertainty of the paper's efficiency readings, eq. (3) [-]."""

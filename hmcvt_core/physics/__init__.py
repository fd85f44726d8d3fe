# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The power balance of one stage, the effects that change it, and the paper's formulas."""

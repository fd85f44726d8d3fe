# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Trials of the product, run from a clone; nothing of them is installed."""

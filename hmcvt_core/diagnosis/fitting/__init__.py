# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Refits of hypotheses, their evidence, and their cross-validated errors."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random recordings of a bench with a known truth, written apart from the readers."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which test to run next, and which effects a plan can distinguish."""

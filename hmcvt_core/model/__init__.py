# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The efficiency model in a user's hands: lookup, optimum, map, domain, parameter file."""

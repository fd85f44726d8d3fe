# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Systems on a bench: what the diagnosis has to know of a transmission, of a hydrostatic unit."""

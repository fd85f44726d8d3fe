# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the diagnosis has to know of a system on a bench."""

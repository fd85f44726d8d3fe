# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which explanations of a gap compete, and how probable each is."""

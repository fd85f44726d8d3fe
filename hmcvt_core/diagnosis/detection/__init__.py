# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Whether there is a gap, and in which regions."""

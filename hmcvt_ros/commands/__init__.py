# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The commands `hmcvt import-bag` and `hmcvt node`."""

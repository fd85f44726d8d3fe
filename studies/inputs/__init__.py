# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random work cycles, engine maps and vehicle files of known content."""

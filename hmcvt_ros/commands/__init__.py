# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Commands that this package adds to the command `hmcvt`."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How exactly exported code answers, how large it is, and which compilers build it."""

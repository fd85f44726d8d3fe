# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random and damaged cycles, engine maps and vehicle files, read: is a value ever wrong?"""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random cycles, engine maps and vehicle files, read: is a value ever wrong?

`damage` reads damaged files of every kind: does a reader hang, or end in a traceback?
"""

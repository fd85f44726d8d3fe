# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Is wear of a gearbox whose physics are written apart named a year later?

box     a gearbox of five stages with reverse: the truth
tables  its tests as bench samples, and its transmission file
trial   machines of its type, sound and a year later, diagnosed
"""

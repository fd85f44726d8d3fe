# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Systems on a bench, as the diagnosis sees them.

transmission  a transmission, and the entry points `diagnose`, `next_test`, `separable`
unit          a single pump or motor
baseline      a change against the baseline of a sound machine
own_system    what a `System` of a user needs: a base for its effects, a reader of its samples
simulator     a machine that a user has as a function, switches for its effects included
"""

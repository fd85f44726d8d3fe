# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The benchmarks: `make bench`, which writes docs/studies/timings.md.

timing      calls that take turns, and what their times say
drive_line  stage, engine speed and stroke of least fuel: against brute force
point       one lookup, many at once, the optimum: against a table and against brute force
calls       every documented call of `efficiency`: against the exported C and SciPy
compiled    what a compiled core would gain
fitting     identification: time, and whether the annealing arrives by itself
"""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A benchmark of methods that say where, which and how far a model differs from its bench.

    python -m studies.benchmark

makes the cases, has every method answer them and writes docs/studies/benchmark.md. That page states
the files, so that a method in any language can take part.

generator  cases and their truth, from the plants of studies/blind; frozen, with a version
model      the served model at its refit, and what each effect changes, as tables in a case
case       reads the folder of a case
answer     the one file that a method writes
rig        measured cases: windows of a pump with known faults
methods    hmcvt and five baselines, each a function from a case to an answer
running    writes one case, or has one method answer one
scorer     answers against the truth; imports nothing of hmcvt
page       the table of all methods
"""

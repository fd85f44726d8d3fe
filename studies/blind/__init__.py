# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A virtual HMCVT test bench whose physics are written apart from the served model.

It exists to try the gap diagnosis blind: a plant with hidden effects, in other functional forms
than the diagnosis carries, and with a base that is a little off, gives campaigns of bench samples.
The trial hands the diagnosis the columns of the bench alone, and then holds the answer against
what was hidden. The plant (`campaign` and what it imports) imports nothing of the product but its
errors; `trial`, `loop` and `scoring` need it.

twin         the first plant: one stage, brought to its `steady` state; its effects, of the class in
             `effect`, in `drag`, `hydrostatics`, `meters` and `unknown`
bench        the second plant: several layouts, sessions, meters, warm oil
renewed      the third plant: all losses in forms of the literature that the library lacks
campaign     bench samples of a twin; `catalogue` draws its effects, `plans` its operating points
conditions   which campaigns a trial makes; `visible`: which effects their readings can show
trial        a campaign diagnosed, and its answer held against the truth; `scoring` adds up
loop         test by test, until the diagnosis has enough
sensitivity  how much each constant of the diagnosis matters
"""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A virtual HMCVT test bench whose physics are written apart from the served model.

It exists to try the gap diagnosis blind: a plant with hidden effects, in other functional forms
than the diagnosis carries, and with a base that is a little off, gives campaigns of bench samples.
The trial hands the diagnosis the columns of the bench alone, and then holds the answer against
what was hidden. The plant (`campaign` and what it imports) imports nothing of the product but its
errors; `trial`, `loop` and `scoring` need it.

twin       the first plant: one stage, its effects in `drag`, `hydrostatics`, `meters`, `unknown`
bench      the second plant: several layouts, sessions, meters, warm oil
renewed    the third plant: an opponent's, whose forms the library lacks
campaign   bench samples of a twin; `catalogue` draws its effects, `plans` its operating points
trial      a campaign diagnosed, and its answer held against the truth; `scoring` adds up
loop       test by test, until the diagnosis has enough
"""

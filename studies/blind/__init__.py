# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A virtual HMCVT test bench whose physics are written apart from the served model.

It exists to try the gap diagnosis blind: a plant with hidden effects, in other functional forms
than the diagnosis carries, and with a base that is a little off, gives campaigns of bench samples.
The trial hands the diagnosis the columns of the bench alone, and then holds the answer against
what was hidden. The plant (`campaign` and what it imports) imports nothing of the product but its
errors.

train         gear data and power flow of stage HM4
effect        what an effect may act on (hooks) and the conditions it sees
hydrostatics, drag, oil, meters, unknown   the effects themselves
misfit        what the form of the base misses
catalogue     effect by name; scaling an effect to a wanted shift of efficiency
twin          the plant: eqs (13)-(15) integrated to steady state, then read by its meters
steady        the time integrator
plans         operating points
campaign      a campaign of noisy samples with its label
visible       what of its effects can be seen
conditions    which campaigns a trial makes
trial, loop   a campaign diagnosed and scored; a small one led on test by test; these need the
              product, as does all below
scoring       rates and their intervals
"""

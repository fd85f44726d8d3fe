# SPDX-License-Identifier: Apache-2.0
"""A virtual HMCVT test bench whose physics are written apart from the served model.

It exists to try the gap diagnosis blind: a plant with hidden effects, in other functional forms
than the diagnosis carries, gives campaigns of bench samples whose labels are sealed. Nothing here
imports the served model, the identification or the diagnosis, and none of them imports this.

train         gear data and power flow of stage HM4
effect        what an effect may act on (hooks) and the conditions it sees
hydrostatics, friction, drag, gearing, oil, meters, unknown   the effects themselves
catalogue     effect by name; scaling an effect to a wanted shift of efficiency
twin          the plant: eqs (13)-(15) integrated to steady state, then read by its meters
steady        the time integrator
plans         operating points
campaign      a campaign of noisy samples with its label
seal          sealing a label and opening the seal
"""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The power balance of one stage, the effects that change it, and the paper's formulas.

formulation   the two sets of equations behind one interface
balance       the power balance, which is served: without effects in closed form (`regimes`,
              `steady_state`, `single_point`), with them shaft by shaft (`shafts`, `broyden`)
published     the formulas as the paper prints them, for comparison alone
effects       what the base model leaves out
readings      what a bench reads, one function for each channel
point_losses  where the power goes at one point
"""

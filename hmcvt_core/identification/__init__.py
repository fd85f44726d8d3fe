# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Identification of the hydraulic parameters from bench samples.

identify   samples in, a model out: `campaign` checks them, `annealing` and `criterion` fit
problem    residuals and objective of candidate parameters; `side_by_side` searches from many starts
refit      the model in service (`prior`) refined by new samples, as far as these determine it
           (`update`), and judged on samples that it has not seen (`cross_validation`)
robust     which samples belong together
precision  standard errors; `profile` gives intervals, `misfit` what the model misses
piecewise  starts of the annealing by the paper's two parts: hydraulic efficiency first
result     the outcome, `remarks` on what the samples leave open
"""

from .annealing import Schedule
from .identify import identify
from .result import Identification

__all__ = ["Identification", "Schedule", "identify"]

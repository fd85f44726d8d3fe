# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Methods of the benchmark by name: modules with `answer(case)`. The baselines share `linear`."""

METHODS = {
    "hmcvt": "hmcvt_diagnosis",
    "forward BIC": "forward_bic",
    "LASSO": "lasso",
    "Gaussian process": "gaussian_process",
    "boosting": "boosting",
    "Kennedy-O'Hagan": "kennedy_ohagan",
}
"""Module of each method."""

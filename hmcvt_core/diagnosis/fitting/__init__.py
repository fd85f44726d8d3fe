# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Refits of hypotheses, their evidence, and their cross-validated errors.

hypothesis        the base model with some effects, their sizes free
refit             its refit to the bench
evidence          evidence of linear models with Gaussian priors and unknown noise
cross_validation  errors of linear models at held-out samples
"""

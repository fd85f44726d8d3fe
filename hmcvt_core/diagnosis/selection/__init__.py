# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which explanations of a gap compete, and how probable each is.

search       sets of effects worth comparing; the linear `screen` proposes them
explanation  a set of effects, with or without a discrepancy: its evidence
discrepancy  what neither the base nor a listed effect explains (`families` of them)
posterior    probabilities of all explanations, and the gap averaged over them
classes      effects that no test distinguishes
prediction   what one explanation predicts at possible tests
"""

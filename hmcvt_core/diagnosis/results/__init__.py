# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The outcome of a diagnosis: the analysis summarised, as values and in words.

summary    causes, sets, parameters and lost power from an analysis
where      regions that summarise the estimated gap
shrinkage  how far the gap shrinks, by cross-validation or held-out samples
outcome    the values, `diagnosis` the same with its report and picture
text       the report (`sentences`, `notes`, `stages`)
"""

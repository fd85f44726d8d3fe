# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Test for a gap over boxes of samples; `results.where` reports where the gap is.

significance  p value of what the refit of the base model leaves, over regions and effects
regions       boxes over the samples, and the fewest that hold given samples
"""

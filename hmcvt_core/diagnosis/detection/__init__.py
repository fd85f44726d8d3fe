# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Whether there is a gap, and in which regions.

significance  the test for a gap: is anything left after the refit
regions       boxes over the samples, and the fewest that hold given samples
"""

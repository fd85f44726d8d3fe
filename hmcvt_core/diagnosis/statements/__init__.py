# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the evidence supports, one module for each statement of a diagnosis.

agreement: do the readings agree with the noise that was stated for them?
scatter: does something vary that was not recorded, and over which time?
members: which effects are present, whatever else is?
verdict: the statements in one word.
"""

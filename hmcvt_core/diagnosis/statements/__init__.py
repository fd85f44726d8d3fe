# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the evidence supports, one module for each statement of a diagnosis.

agreement: do the readings agree with the noise that was stated for them?
scatter: does something vary that was not recorded, and over which time?
members: which effects are present, whatever else is?
explained: which part of the change do they explain, and is their form right?
verdict: the statements in one word.
"""

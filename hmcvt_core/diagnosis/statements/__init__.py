# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the evidence supports, one module for each statement of a diagnosis.

agreement  the readings against their stated noise, once the base model is refitted
scatter    what scatters more than stated, and over which time the cause varies
members    effects that are present, whichever others are
verdict    one word from all of these
"""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which test to run next, and which effects a plan can distinguish.

next_test    the test that distinguishes most, and when to stop
advice       what to measure next, as values and in words
isolability  what a plan can show and distinguish before anything is measured
"""

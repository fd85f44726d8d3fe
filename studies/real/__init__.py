# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The gap on real rigs: changes against a sound state, and bands that are held out."""

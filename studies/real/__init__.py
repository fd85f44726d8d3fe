# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Real machines: a rig with known faults against its sound state; units with a band held out."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The endurance trial of the node: `make soak`, which writes docs/studies/soak.md.

This process makes the load, measures and reports; the node and a bare relay to compare it with
are processes of their own, reached over DDS on the loopback interface.
"""

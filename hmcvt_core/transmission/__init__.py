# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a transmission is: gear train, pump-motor pair, hydraulic parameters, ranges."""

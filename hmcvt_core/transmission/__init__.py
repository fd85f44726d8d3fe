# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Description of a transmission: registry of quantities, gear train, hydraulic parameters."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt estimate` on twins of a tractor's bus: error and coverage of the intervals."""

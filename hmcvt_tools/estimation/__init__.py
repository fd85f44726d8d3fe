# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The bus as a dynamometer: output torque, power and losses from what a machine's log states.

`solving` inverts the model at every row, `intervals` says how well the result is known, `totals`
adds it up, and `log` runs all three over a log in bounded memory. `bus_watch` reports a drift of
what the bus states twice.
"""

from .log import Estimate, estimate
from .settings import EstimateSettings

__all__ = ["Estimate", "EstimateSettings", "estimate"]

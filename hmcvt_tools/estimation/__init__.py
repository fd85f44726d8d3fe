# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The bus as a dynamometer: output torque, power and losses from what a machine's log states.

solving    the model inverted: the load behind an engine torque
rows       the estimate at every row of a log
intervals  its standard deviations; `settings` states the errors of a bus
condition  what differs from the machine identified: oil temperature, wear
totals     energies, fuel and hours, added up
log        all of this over a log in bounded memory
bus_watch  a watch on quantities that the bus states twice
"""

from .log import Estimate, estimate
from .settings import EstimateSettings

__all__ = ["Estimate", "EstimateSettings", "estimate"]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Fuel over a work cycle: what strategies need, and the least that is possible.

vehicle     the tractor around the transmission, and the limits of its parts
cycle       the demand, second by second
points      working points that hold it
moves       which of them the machine reaches within a step
strategies  what chooses among them
run         a strategy over a cycle
controller  the causal strategy for a running tractor, demand by demand
bound       least fuel by dynamic programming
energy      where the engine's work goes
knowledge   what knowledge of the transmission is worth, in fuel
result      all of it as one answer
"""

from .cycle import CYCLES, Cycle, read_cycle
from .points import Drive
from .result import Mission, Planned
from .strategies import STRATEGIES, Choice, Situation
from .vehicle import Limits, Vehicle, load_vehicle

__all__ = [
    "CYCLES",
    "STRATEGIES",
    "Choice",
    "Cycle",
    "Drive",
    "Limits",
    "Mission",
    "Planned",
    "Situation",
    "Vehicle",
    "load_vehicle",
    "read_cycle",
]

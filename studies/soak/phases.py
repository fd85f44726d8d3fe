# SPDX-License-Identifier: Apache-2.0
"""The three trials under load: steady, during refits, and with a rate that rises.

The node and the relay take turns, so that whatever else the machine does meets both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hmcvt_core import EfficiencyModel, load_model

from .load import Segment, Target
from .points import TOPICS, Cycle, answered
from .refits import Refits

REST = 0.7
"""Pause before each stretch [s], longer than inputs stay fresh: each begins from silence."""


@dataclass(frozen=True)
class Counted:
    """A stretch of load on the node, with what the node says about it.

    Attributes:
        segment: as seen from outside.
        accepted: arrivals that the node has heard, by its own count.
        answered: arrivals that it has answered, by its own count.
    """

    segment: Segment
    accepted: int
    answered: int


@dataclass(frozen=True)
class Turn:
    """The node and the relay, one after the other.

    Attributes:
        node: under the load, during refits if there are any.
        relay: under the same load, on a machine that does nothing else.
        relay_beside: the same while the node refits; None where it does not.
    """

    node: Counted
    relay: Segment
    relay_beside: Segment | None = None


@dataclass(frozen=True)
class Bench:
    """What the trials need: two processes and what each must answer."""

    node: Target
    relay: Target
    model: EfficiencyModel
    node_cycle: Cycle
    relay_cycle: Cycle
    seed: int


def steady(bench: Bench, rate: float, seconds: float, turns: int) -> list[Turn]:
    """Load the node and the relay in turns."""
    return [Turn(_counted(bench.node, bench.node_cycle, rate, seconds),
                 _rested(bench.relay, bench.relay_cycle, rate, seconds))
            for _ in range(turns)]


def during_refits(bench: Bench, refits: Refits, rate: float, seconds: float, turns: int,
                  samples: int) -> list[Turn]:
    """Load the node while it refits itself all the time, and the relay without and beside that.

    The refits are all of the same samples, so that the first one tells what the node will serve.
    """
    refits.log_samples(bench.node, bench.model, samples, bench.seed)
    refits.poll()
    served = load_model(Path(refits.finish(bench.node)["file"]))
    cycle = answered(served, len(bench.node_cycle.values), bench.seed)
    found = []
    for _ in range(turns):
        node = _counted(bench.node, cycle, rate, seconds, refits.poll)
        beside = _rested(bench.relay, bench.relay_cycle, rate, seconds, refits.poll)
        refits.finish(bench.node)
        found.append(Turn(
            node, _rested(bench.relay, bench.relay_cycle, rate, seconds), beside))
    return found


def rising(target: Target, cycle: Cycle, rates: Sequence[float], seconds: float) -> list[Segment]:
    """Raise the rate until a tenth of the arrivals is not answered."""
    found = []
    for rate in rates:
        found.append(_rested(target, cycle, rate, seconds))
        if found[-1].answers < 0.9 * found[-1].sent:
            break
    return found


def _rested(target: Target, cycle: Cycle, rate: float, seconds: float,
            meanwhile: Callable[[], None] = lambda: None) -> Segment:
    target.ear.listen_for(REST)
    return target.load(cycle, rate, seconds, meanwhile)


def _counted(target: Target, cycle: Cycle, rate: float, seconds: float,
             meanwhile: Callable[[], None] = lambda: None) -> Counted:
    target.ear.listen_for(REST)
    accepted, answers = target.counts()
    segment = target.load(cycle, rate, seconds, meanwhile)
    accepted_after, answers_after = target.counts()
    # The load begins with a set of three, of which the last is answered.
    return Counted(segment, accepted_after - accepted - TOPICS, answers_after - answers - 1)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nonsense on the three inputs, and what the node may say to it: nothing, or what is right.

Reliable subscriptions that hold a whole burst, so that nothing is lost and every count is exact.
"""

import math
import struct
from collections import Counter
from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np
from std_msgs.msg import Float64

from hmcvt_core import EfficiencyModel

from .load import Target
from .points import ORDINARY

# As the interface promises it, not as the code has it.
LIMITS = {
    "displacement_ratio": (-1.02, 1.02),
    "engine_speed": (10.0, 320.0),
    "load_torque": (-5000.0, 5000.0),
}
"""What is accepted."""
FULL_STROKE = 1.0  # what is beyond is noise, and taken as this
MIN_LOAD = 1.0  # N m; below it coasts, and there is no efficiency
TOPICS = tuple(LIMITS)
STROKE, _, LOAD = TOPICS
TAKEN, COASTING = f"{STROKE} taken as the limit", "points not answered, coasting"
REASONS = ("not finite", "out of range")
DEPTH = 5000
_BURST, _SILENT = 200, 20  # messages on one topic; each so many of them is to silence

_NONSENSE = (
    math.nan,
    -math.nan,
    math.inf,
    -math.inf,
    5e-324,
    -5e-324,
    2.2e-308,
    -0.0,
    0.0,
    1.7e308,
    -1.7e308,
    1e30,
    50.0,
    1.5,
    750.0,
    2200.0,
    -100.0,
    1e-6,
)
_EDGES = {
    **LIMITS,
    STROKE: (*LIMITS[STROKE], -FULL_STROKE, FULL_STROKE),
    LOAD: (*LIMITS[LOAD], MIN_LOAD),
}


def overrides(namespace: str) -> dict[str, Any]:
    """Return the parameters that a node needs to lose nothing and find no input stale."""
    profiles: dict[str, Any] = {"input_timeout": 60.0}
    for topic in (*TOPICS, "bench_sample"):
        profiles[f"qos_overrides.{namespace}/{topic}.subscription.reliability"] = (
            "reliable"
        )
        profiles[f"qos_overrides.{namespace}/{topic}.subscription.depth"] = DEPTH
    for topic in ("efficiency", "optimal_displacement_ratio"):
        profiles[f"qos_overrides.{namespace}/{topic}.publisher.depth"] = DEPTH
    return profiles


class Oracle:
    """What a node that keeps its promises has counted and published after some messages.

    Attributes:
        counts: by the keys of diagnostics.
        efficiency, optimum: what must have been published since they were last cleared, in order.
        answers: how many efficiencies in all.
    """

    def __init__(self, model: EfficiencyModel) -> None:
        self.counts = Counter(
            {
                f"{topic} {what}": 0
                for topic in TOPICS
                for what in (
                    "received",
                    "accepted",
                    *(f"refused, {reason}" for reason in REASONS),
                )
            }
        )
        self.counts.update({TAKEN: 0, COASTING: 0})
        self.efficiency: list[float] = []
        self.optimum: list[float] = []
        self.answers = 0
        self._inputs: dict[str, float | None] = dict.fromkeys(TOPICS)
        self._model_efficiency = lru_cache(1 << 14)(model.efficiency)
        self._model_optimum = lru_cache(1 << 14)(model.optimal_displacement_ratio)

    def hear(self, topic: str, value: float) -> None:
        """Take a message as the node should."""
        low, high = LIMITS[topic]
        valid = low <= value <= high
        reason = REASONS[math.isfinite(value)]
        self.counts[f"{topic} received"] += 1
        self.counts[f"{topic} accepted" if valid else f"{topic} refused, {reason}"] += 1
        if topic == STROKE and valid and abs(value) > FULL_STROKE:
            self.counts[TAKEN] += 1
            value = math.copysign(FULL_STROKE, value)
        self._inputs[topic] = value if valid else None
        point = [self._inputs[name] for name in TOPICS]
        if not valid or None in point:
            return
        _, _, load = point
        if load is not None and load < MIN_LOAD:
            self.counts[COASTING] += 1
            return
        efficiency = float(self._model_efficiency(*point))
        best = float(self._model_optimum(*point[1:]).displacement_ratio)
        if math.isfinite(efficiency):
            self.efficiency.append(efficiency)
            self.answers += 1
        if math.isfinite(best):
            self.optimum.append(best)


class InputFuzzer:
    """Sends nonsense to a node started with `overrides`, connected, and holds it to an oracle.

    Waits `patience` [s] for what is due; only a failure takes as long.

    Attributes:
        sent: count of messages.
        oracle: what must have come of them.
        differences: where the node did something else; empty when it kept its promises.
    """

    def __init__(
        self, target: Target, model: EfficiencyModel, seed: int, patience: float = 20.0
    ) -> None:
        self.sent = 0
        self.oracle = Oracle(model)
        self.differences: list[str] = []
        self._target, self._patience = target, patience
        self._random = np.random.default_rng(seed)
        self._publishers = dict(zip(TOPICS, target.inputs, strict=True))

    def run(self, count: int) -> None:
        """Send about `count` messages; stop at the first difference."""
        self._target.counts()  # waits until the node tells any
        bursts = 0
        while self.sent < count and not self.differences:
            topic, other, last = map(str, self._random.permutation(TOPICS))
            self._set(other)
            self._set(last)
            self._burst(topic, other if bursts % _SILENT == 0 else "")
            bursts += 1
        self._compare_counts()

    # --- what is sent -------------------------------------------------------------------------

    def _burst(self, topic: str, silenced: str) -> None:
        """Send nonsense and good values on a topic; no word may come while another is not good."""
        if silenced:
            self._send(silenced, [self._silencing(silenced)])
            self._compare_counts()  # which also waits until it was heard
        self._send(topic, (self._value(topic) for _ in range(_BURST)))
        self._set(topic)
        if silenced:
            self._compare_counts()
            self._set(silenced)

    def _silencing(self, topic: str) -> float:
        """Draw a value that has no answer: a load that coasts, or no number."""
        if topic == LOAD:
            return float(self._random.uniform(LIMITS[LOAD][0], MIN_LOAD))
        return float(self._random.choice(_NONSENSE[:4]))

    def _set(self, topic: str) -> None:
        """Send a good value and wait for the answers to everything up to it."""
        self._send(topic, [self._ordinary(topic)])
        self._compare_outputs()

    def _send(self, topic: str, values: Iterable[float]) -> None:
        for value in values:
            self._publishers[topic].publish(Float64(data=value))
            self.oracle.hear(topic, value)
            self.sent += 1

    def _value(self, topic: str) -> float:
        """Draw a value: nonsense, arbitrary bits, the limits and their neighbours, good ones."""
        random, (low, high) = self._random, LIMITS[topic]
        kind = random.integers(5)
        if kind == 0:
            return float(random.choice(_NONSENSE))
        if kind == 1:
            return float(struct.unpack("<d", random.bytes(8))[0])
        if kind == 2:
            limit = float(random.choice(_EDGES[topic]))
            return float(
                random.choice(
                    [np.nextafter(limit, -np.inf), limit, np.nextafter(limit, np.inf)]
                )
            )
        return float(random.uniform(low, high)) if kind == 3 else self._ordinary(topic)

    def _ordinary(self, topic: str) -> float:
        low, high = ORDINARY[TOPICS.index(topic)]
        return float(self._random.choice(np.linspace(low, high, 50)))

    # --- what comes back ----------------------------------------------------------------------

    def _compare_outputs(self) -> None:
        """Wait for as many answers as there must be, and compare each of them."""
        pairs = (
            (self._target.efficiency.values, self.oracle.efficiency),
            (self._target.optimum.values, self.oracle.optimum),
        )
        self._target.ear.listen_until(
            lambda: all(len(heard) >= len(due) for heard, due in pairs), self._patience
        )
        for heard, due in pairs:
            if heard != due:
                first = next(
                    (
                        i
                        for i, (one, other) in enumerate(zip(heard, due, strict=False))
                        if one != other
                    ),
                    min(len(heard), len(due)),
                )
                self.differences.append(
                    f"answer {first} of {len(due)} is {heard[first : first + 1]}, not "
                    f"{due[first : first + 1]}; {len(heard)} came"
                )
        self.differences += [
            f"efficiency {value} was published"
            for value in pairs[0][0]
            if not 0.0 < value < 1.0
        ]
        self._target.forget()
        self.oracle.efficiency.clear()
        self.oracle.optimum.clear()

    def _compare_counts(self) -> None:
        """Wait until the counts in diagnostics are those of the oracle, and compare the rest."""
        due = {**self.oracle.counts, "points answered": self.oracle.answers}

        def counted() -> dict[str, int]:
            return {
                key: int(self._target.statuses.values["inputs"][key]) for key in due
            }

        if not self._target.ear.listen_until(lambda: counted() == due, self._patience):
            self.differences.append(f"diagnostics count {counted()}, not {due}")
        self._compare_outputs()

# SPDX-License-Identifier: Apache-2.0
"""What is sent under load, and the answer that each arrival must get."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hmcvt_core import EfficiencyModel
from hmcvt_ros.inputs import INPUT_RANGES

ORDINARY = ((-0.5, 0.9), (100.0, 200.0), (100.0, 400.0))
"""Where every point has an answer: displacement ratio [-], engine speed [rad/s], load torque
[N m], in the order of `INPUT_RANGES`."""
TOPICS = len(INPUT_RANGES)

Inputs = tuple[float, ...]
"""The last value of each topic."""


class Answer(NamedTuple):
    """One message on each output."""

    efficiency: float
    optimum: float


@dataclass(frozen=True)
class Cycle:
    """Arrivals that repeat without end, one topic after the other, and their answers.

    Attributes:
        values: of the arrivals; number i goes to topic i % 3 of `INPUT_RANGES`.
        answers: to each arrival, when those before it were heard in the order sent.
        answer: to an arrival on a topic that makes the inputs what they are.
    """

    values: tuple[float, ...]
    answers: tuple[Answer, ...]
    answer: Callable[[int, Inputs], Answer]

    def __len__(self) -> int:
        return len(self.values)

    def value(self, arrival: int) -> float:
        """Return the value of arrival number `arrival` since the start."""
        return self.values[arrival % len(self.values)]


def echoed(count: int, seed: int) -> Cycle:
    """Return `count` arrivals as the relay answers them."""
    return _cycle(count, seed, lambda topic, inputs: Answer(inputs[topic], inputs[topic]))


def answered(model: EfficiencyModel, count: int, seed: int) -> Cycle:
    """Return `count` arrivals as a node that serves `model` answers them."""
    def answer(topic: int, inputs: Inputs) -> Answer:
        _, engine_speed, load_torque = inputs
        best = model.optimal_displacement_ratio(engine_speed, load_torque)
        return Answer(float(model.efficiency(*inputs)), float(best.displacement_ratio))

    return _cycle(count, seed, answer)


def _cycle(count: int, seed: int, answer: Callable[[int, Inputs], Answer]) -> Cycle:
    low, high = np.transpose(ORDINARY)
    rounds = np.random.default_rng(seed).uniform(low, high, (count // TOPICS, TOPICS))
    values = tuple(map(float, rounds.ravel()))
    inputs = list(values[-TOPICS:])
    answers = []
    for i, value in enumerate(values):
        inputs[i % TOPICS] = value
        answers.append(answer(i % TOPICS, tuple(inputs)))
    return Cycle(values, tuple(answers), answer)

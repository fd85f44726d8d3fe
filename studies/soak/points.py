# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is sent under load, the answer that each arrival must get, and which arrival one belongs to.

The arrivals of one topic are taken in the order sent. Those of two topics are not when they wait
at the same time, and with best effort an arrival may be lost: the answer then is to a point that
was never sent as such. So an answer belongs to the arrival that, after those answered before, makes
the inputs a point with exactly this answer.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hmcvt_core import EfficiencyModel
from hmcvt_ros.inputs import INPUT_RANGES

ORDINARY = ((-0.5, 0.9), (100.0, 200.0), (100.0, 400.0))
"""Where every point has an answer: displacement ratio [-], engine speed [rad/s], load torque
[N m], in the order of `INPUT_RANGES`."""
TOPICS = len(INPUT_RANGES)

_AHEAD = 20  # arrivals of one topic that may be lost in a row

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
    return _cycle(
        count, seed, lambda topic, inputs: Answer(inputs[topic], inputs[topic])
    )


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


class Matches(NamedTuple):
    """Answers and their arrivals.

    Attributes:
        pairs: number of an answer, number of its arrival.
        repeats: answers that say again what the answer before said; any others that have no
            arrival are wrong.
    """

    pairs: tuple[tuple[int, int], ...]
    repeats: int


def match(cycle: Cycle, sent: int, answers: Sequence[Answer]) -> Matches:
    """Match the answers to the arrivals 0, 1, ..., `sent` - 1 of a cycle.

    The three arrivals before them are those at the end of the cycle.
    """
    known = {answer: i for i, answer in enumerate(cycle.answers)}
    last = list(range(-TOPICS, 0))  # arrival that each topic stands at
    pairs = []
    repeats = 0
    before = cycle.answers[-1]
    for number, answer in enumerate(answers):
        arrival = _next(cycle, sent, last, answer)
        if arrival is not None:
            last[arrival % TOPICS] = arrival
        elif answer == before:
            repeats += 1
        elif answer in known:
            # Answers are missing; this one is to an arrival further on, heard in order.
            arrival = max(last) + 1
            arrival += (known[answer] - arrival) % len(cycle)
            last = sorted(
                range(arrival - TOPICS + 1, arrival + 1), key=lambda i: i % TOPICS
            )
        if arrival is not None and arrival < sent:
            pairs.append((number, arrival))
        before = answer
    return Matches(tuple(pairs), repeats)


def _next(cycle: Cycle, sent: int, last: Sequence[int], answer: Answer) -> int | None:
    """Return the first arrival after `last` that gives an answer, None if none does."""
    ahead = sorted(
        last[topic] + step * TOPICS
        for topic in range(TOPICS)
        for step in range(1, _AHEAD + 1)
    )
    for arrival in itertools.takewhile(lambda number: number < sent, ahead):
        topic = arrival % TOPICS
        stand = [*last]
        stand[topic] = arrival
        if max(stand) - min(stand) == TOPICS - 1 and max(stand) == arrival:
            given = cycle.answers[arrival % len(cycle)]
        else:
            given = cycle.answer(topic, tuple(map(cycle.value, stand)))
        if given == answer:
            return arrival
    return None

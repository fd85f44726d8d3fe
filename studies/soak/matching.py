# SPDX-License-Identifier: Apache-2.0
"""Which arrival an answer belongs to.

The arrivals of one topic are taken in the order sent. Those of two topics are not when they wait
at the same time, and with best effort an arrival may be lost: the answer then is to a point that
was never sent as such. So an answer belongs to the arrival that, after those answered before, makes
the inputs a point with exactly this answer.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from .points import TOPICS, Answer, Cycle

_AHEAD = 20  # arrivals of one topic that may be lost in a row


@dataclass(frozen=True)
class Matches:
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
            last = sorted(range(arrival - TOPICS + 1, arrival + 1), key=lambda i: i % TOPICS)
        if arrival is not None and arrival < sent:
            pairs.append((number, arrival))
        before = answer
    return Matches(tuple(pairs), repeats)


def _next(cycle: Cycle, sent: int, last: Sequence[int], answer: Answer) -> int | None:
    """Return the first arrival after `last` that gives an answer, None if none does."""
    ahead = sorted(last[topic] + step * TOPICS
                   for topic in range(TOPICS) for step in range(1, _AHEAD + 1))
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

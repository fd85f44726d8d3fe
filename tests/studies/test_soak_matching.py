# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An answer is given to the arrival that it belongs to, or to none."""

import pytest

from studies.soak.points import Answer, Cycle, Inputs, match


def answer(topic: int, inputs: Inputs) -> Answer:
    first, second, third = inputs
    return Answer(first + 1e3 * second + 1e6 * third, second)


LENGTH = 90
SENT = 1000


def after(order, inputs=(LENGTH - 2.0, LENGTH - 1.0, float(LENGTH))):
    """The answers when the arrivals are heard in some order; 1, 2, ... are their values."""
    inputs = list(inputs)
    answers = []
    for arrival in order:
        inputs[arrival % 3] = float(arrival % LENGTH + 1)
        answers.append(answer(arrival % 3, tuple(inputs)))
    return answers


@pytest.fixture(scope="module")
def cycle():
    values = tuple(map(float, range(1, LENGTH + 1)))
    return Cycle(values, tuple(after(range(LENGTH))), answer)


@pytest.mark.parametrize(
    "order",
    [
        range(9),
        range(100),  # more than a cycle
        [0, 2, 1, 3, 5, 4, 6],  # two topics change places
        [1, 2, 0, 3, 4, 5],
        [0, 1, 2, 5, 3, 4, 6, 7, 8],
        [0, 1, 2, 4, 5, 6, 7, 8],  # one is lost
        [0, 1, 2, 3, 10, 11, 12, 13],  # several are lost
        [0, 1, 2, 51, 54, 55, 56, 58],
        [*range(5), *range(8, 40)],  # those that follow are not hidden
    ],
)
def test_order_in_which_arrivals_were_heard_is_found(cycle, order):
    found = match(cycle, SENT, after(order))
    assert found.pairs == tuple(enumerate(order))
    assert found.repeats == 0


def test_repeated_and_foreign_answers_belong_to_no_arrival(cycle):
    first, second, third = after(range(3))
    found = match(cycle, SENT, [first, first, second, Answer(0.5, 2.0), third])
    assert found.pairs == ((0, 0), (2, 1), (4, 2))
    assert found.repeats == 1


def test_wrong_second_output_is_no_answer(cycle):
    first, second, _ = after(range(3))
    found = match(cycle, SENT, [first, second._replace(optimum=7.0)])
    assert (found.pairs, found.repeats) == (((0, 0),), 0)

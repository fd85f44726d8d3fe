# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is made of the probabilities of sets: who is told from whom."""

from types import SimpleNamespace

import pytest

from hmcvt_core.diagnosis.advice import _labels
from hmcvt_core.diagnosis.procedure import _twins
from hmcvt_core.diagnosis.ranking import Ranking


def _explained(*sets):
    """A ranking of sets by their probabilities; a star says that a loss stands beside one."""
    rivals = [(SimpleNamespace(names=tuple(text.rstrip("*").split("+")), of_base=False,
                               beside="loss" if text.endswith("*") else None,
                               listed=lambda bare, text=text: 0.5 if "*" in text else 1.0), p)
              for text, p in sets]
    return Ranking(tuple(rivals), bare=SimpleNamespace(), no_gap=0.0)


@pytest.mark.parametrize(("sets", "name", "others"), [
    ([("a", 0.45), ("b", 0.4), ("c", 0.1)], "a", ("b",)),
    ([("a", 0.45), ("b", 0.4), ("c", 0.1)], "c", ("a", "b")),  # outside: what it is taken for
    ([("a", 0.8), ("b", 0.2)], "a", ()),  # 80 % is enough
    ([("a", 0.79), ("b", 0.15), ("c", 0.06)], "a", ("b",)),
    ([("a+b", 0.5), ("c", 0.45), ("d", 0.05)], "c", ("a",)),  # b would add nothing
    ([("a+b", 0.6), ("b+c", 0.3), ("b", 0.1)], "a", ("c",)),  # b alone is no alternative to a
])
def test_the_company_of_a_cause_is_the_smallest_set_that_holds_it(sets, name, others):
    assert _twins(_explained(*sets), name) == others


def test_a_set_is_told_from_the_loss_that_stands_beside_it():
    labels = _labels(_explained(("a*", 0.7), ("a", 0.3)))
    assert labels[("a",)][0].beside is None
    assert labels[()][0].beside is not None
    assert labels[("a",)][1] == pytest.approx(0.65)

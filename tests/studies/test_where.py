# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The study of where, on few campaigns."""

import pytest

from studies.stability import FIRST_SEED, Case
from studies.where import Score, score, scores_table


@pytest.mark.long
@pytest.mark.parametrize("generator", ["twin", "bench"])
def test_regions_hold_more_of_the_gap_than_all_samples(generator):
    scored = score(Case(generator, 0, FIRST_SEED))
    assert scored.generator == generator
    assert scored.count > 0
    assert 1.0 >= scored.regions > scored.everything


@pytest.mark.long
def test_nothing_hidden_is_not_scored():
    assert score(Case("bench", 2, FIRST_SEED)) is None


def test_table_has_means_by_generator():
    scores = [
        Score("twin", "pair", "ambiguous", 0.5, 0.7, 0.4, 1),
        Score("twin", "pair", "ambiguous", 0.7, 0.9, 0.4, 3),
    ]
    rows = scores_table(scores).splitlines()
    assert rows[2] == "| twin | 2 | 0.60 | 0.80 | 0.40 | 2.0 |"
    assert rows[3].startswith("| all | 2 | 0.60")

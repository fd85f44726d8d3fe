# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random tables of known content: no import is wrong without a word."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.tables.judge import judge
from studies.tables.truth import random_table


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_no_table_is_read_wrong_without_a_word(tmp_path_factory, seed):
    table = random_table(np.random.default_rng(seed))
    outcome = judge(table, tmp_path_factory.mktemp("table"))
    assert not outcome.wrong, (outcome, table.features, table.text)
    assert outcome.code in (0, 2), outcome


def test_complete_tables_need_no_question(tmp_path):
    tables = [random_table(np.random.default_rng([9, index])) for index in range(100)]
    complete = [table for table in tables if table.complete]
    taken = sum(judge(table, tmp_path).code == 0 for table in complete)
    assert taken >= 0.8 * len(complete)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""No report contradicts itself; `python -m studies.consistency` reads two hundred."""

from dataclasses import replace

import pytest

from studies.consistency import RULES, contradictions

from .campaigns import CASES, diagnosed


@pytest.mark.parametrize("name", list(CASES))
def test_no_report_contradicts_itself(name):
    assert contradictions(diagnosed(name)) == []


def test_the_rules_see_what_they_are_for():
    found = diagnosed("charge pump")
    broken = replace(
        found,
        verdict="no_gap",
        agreement=replace(found.agreement, holds=False),
        where=(replace(found.where[0], p_value=1.0),) if found.where else (),
        delivered=replace(found.delivered, rmse_after=1.0),
    )
    rules = contradictions(broken)
    assert "the saved model is worse" in rules
    assert "no gap above the stated noise" in rules
    assert len(rules) < len(RULES)
    empty = replace(found, causes=())
    assert contradictions(empty) == ["a cause is found, and none is named"]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The trial of a foreign gearbox: its cases, what counts, and its table."""

import pytest

from studies.gearbox.__main__ import answers_table, cases, recorded, share
from studies.gearbox.trial import Answer, Case, answered

LEAK = "laminar_leakage"


def answer(worn=True, verdict="cause_found", first=(LEAK,), **changes):
    values = {
        "case": Case(worn, 12, 0.3, 9000),
        "verdict": verdict,
        "thin": False,
        "first": first,
        "probabilities": dict.fromkeys(first, 0.9),
        "growth": (0.6, 0.55, 0.65),
        "component": "pump",
    }
    return Answer(**{**values, **changes})


def test_processes_find_the_work():
    # They do not import what belongs to `__main__`.
    assert answered.__module__ == "studies.gearbox.trial"


def test_every_machine_comes_in_every_kind():
    drawn = cases(2, (12, 24), (0.3, 1.5), 9000)
    assert len(set(drawn)) == 16
    assert {case.seed for case in drawn[:8]} == {9000}


def test_answers_are_read_back(tmp_path):
    path = tmp_path / "answers.jsonl"
    assert recorded(path) == []
    given = [answer(), answer(worn=False, verdict="no_gap", first=(), growth=None)]
    path.write_text("".join(item.to_line() + "\n" for item in given))
    assert recorded(path) == given


@pytest.mark.parametrize(
    ("changes", "named", "holds", "absent"),
    [
        ({}, True, True, False),
        ({"growth": (0.5, 0.45, 0.55)}, True, False, False),
        ({"first": (LEAK, "churning")}, False, False, True),
        ({"probabilities": {LEAK: 0.9, "churning": 0.6}}, True, True, True),
        ({"verdict": "unexplained"}, False, False, False),
        ({"worn": False}, True, True, True),
    ],
)
def test_what_counts(changes, named, holds, absent):
    item = answer(**changes)
    assert (item.named, item.holds, item.absent_named) == (named, holds, absent)


def test_the_table_counts_unchanged_and_worn_apart():
    given = [answer(), answer(verdict="no_gap", first=(), growth=None)]
    given.append(answer(worn=False, verdict="no_gap", first=(), growth=None))
    lines = answers_table(given).splitlines()
    assert lines[2].startswith("| unchanged: alarm | 0 of 1 | 0 of 1 (0 to 79 %)")
    assert "| worn: no alarm, not called too thin | 1 of 2 |" in lines[5]
    assert share(given[:0], "alarm") == "0 of 0"

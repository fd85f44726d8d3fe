# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The study of stability, on few campaigns."""

import pytest

from studies.stability import FIRST_SEED, Case, Record, compared, differences, report


@pytest.mark.long
@pytest.mark.parametrize(
    "case",
    [
        Case("bench", 3, FIRST_SEED),
        Case("bench", 7, FIRST_SEED),
        Case("bench", 11, FIRST_SEED),
        Case("twin", 4, FIRST_SEED),
    ],
    ids=str,
)
def test_last_digits_change_no_figure(case):
    """On the grids of the bench they once decided which test is nearest to which."""
    record = compared(case)
    assert record.verdicts[0] == record.verdicts[1]
    assert record.changed == ()
    assert not record.words_differ


def test_differences_are_found_by_name():
    one = {
        "sets": [{"effects": ["a"], "probability": 0.6, "gap_after": 0.01}],
        "shared_errors": [{"error": "zero", "value": 1e-9, "expected": 0.1}],
        "verdict": "ambiguous",
    }
    other = {
        "sets": [
            {"effects": ["b"], "probability": 0.0004, "gap_after": None},
            {"effects": ["a"], "probability": 0.6004, "gap_after": 0.0102},
        ],
        "shared_errors": [{"error": "zero", "value": 2e-9, "expected": 0.1}],
        "verdict": "cause_found",
    }
    assert list(differences(one, other)) == [
        (".sets[a].gap_after", 0.01, 0.0102),
        (".verdict", "ambiguous", "cause_found"),
    ]


def test_report_lists_what_differs():
    case = Case("twin", 2, 1)
    record = Record(
        case, "pair", ("no_gap", "no_gap"), ((".gap.rmse", 1.0, 2.0),), True
    )
    lines = report([record]).splitlines()
    assert lines[0] == "twin 2, pair: no_gap -> no_gap"
    assert lines[1] == "  gap.rmse: 1.0 -> 2.0"
    assert lines[2].startswith("1 campaigns: other verdict 0, other words 1")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The studies of intervals and of changes against a sound state."""

import numpy as np

from studies.baseline import Answer, change_table, pump_tests, transmission_tests
from studies.baseline import Case as Change
from studies.coverage import Case, coverage_table, draw, error_table


def record(seed, coverage, error):
    case = Case("unlisted effect", 24, 0.001, seed)
    models = ("identified", "diagnosed", "remainder")
    return {
        "case": case,
        "coverage": dict.fromkeys(models, coverage),
        "error": dict.fromkeys(models, error),
        "base_error": 0.01,
    }


def test_equal_cases_give_equal_campaigns():
    case = Case("unlisted effect", 24, 0.001, 7)
    first = draw(case)
    assert first.samples["efficiency"].shape == (24,)
    assert len(first.bench.effects) == 1
    again = draw(case).samples["efficiency"]
    assert np.array_equal(first.samples["efficiency"], again)
    assert draw(Case("exact", 24, 0.001, 7)).bench.effects == ()
    assert draw(Case("off", 24, 0.001, 7)).bench.options.misfit > 0.0


def test_tables_of_coverage_and_errors():
    records = [record(7, 0.9, 0.005), record(8, 1.0, 0.011)]
    rows = coverage_table(records).splitlines()
    assert rows[2].count("95.0 %") == 3 and "| 2 |" in rows[2]
    assert rows[-1].startswith("| all |")
    assert error_table(records).splitlines()[-1].endswith("| 0.80 | 1.10 | 1 of 2 |")


def test_table_of_changes_counts_answers():
    case = Change("pump", "friction 2 %", 5)
    answers = [
        Answer(case, True, "pump", "cause_found"),
        Answer(case, False, None, "no_gap"),
    ]
    row = "| friction 2 % | 1 of 2 | 1 of 2 | 1 of 2 |"
    assert row in change_table("pump", answers)


def test_simulated_machines_are_measured():
    assert len(transmission_tests((), 5, 24)) == 24
    sound = pump_tests("none", 5, (6, 4))
    leaking = pump_tests("leakage grown by half", 5, (6, 4))
    assert len(sound.speed) == 24
    assert np.all(leaking.flow_loss > sound.flow_loss)

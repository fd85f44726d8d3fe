# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The rules of the verdicts, and what they are fed with."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from studies.reproduce import bench, formulas, paper, subsets, tables
from studies.reproduce.algorithms import Run
from studies.reproduce.comparison import Summary
from studies.reproduce.item import printed
from studies.workers import recorded


@pytest.mark.parametrize(
    ("published", "ours", "form", "verdict"),
    [
        (0.88, 0.8847, ".2f", "reproduced"),
        (0.88, 0.8851, ".2f", "differs"),
        (0.019, 0.01925, ".3f", "reproduced"),
        (4.67e-12, 4.674e-12, ".2e", "reproduced"),
        (4.67e-12, 4.676e-12, ".2e", "differs"),
        (1.0, math.nan, ".2f", "differs"),
    ],
)
def test_printed_number_is_compared_in_its_printed_digits(
    published, ours, form, verdict
):
    found = printed("g", "n", published, ours, form, why="reason", remark="note")
    assert found.verdict == verdict
    assert found.why == ("note" if verdict == "reproduced" else "reason")


def test_items_of_a_wrong_gear_train_differ(monkeypatch):
    """The printed formula does not come from the gear train that it judges."""
    wrong = replace(bench.stage(), planetary_constant=2.6)
    monkeypatch.setattr(formulas, "stage", lambda gear_efficiency=0.98: wrong)
    verdicts = {item.name: item.verdict for item in formulas.items()}
    assert verdicts["speed ratio (5) at eps = 1 (tests 4)"] == "differs"
    assert verdicts["e_H (8) at eps = -1 (tests 1, 5)"] == "differs"


def test_printed_tables_are_those_of_the_paper():
    """The paper's Table 3 nearly follows from its Table 4; a mistyped digit would show."""
    for gear, row in paper.TABLE_4.items():
        again = tables.errors(np.array(row) / 100.0)
        np.testing.assert_allclose(again, paper.TABLE_3[gear], atol=0.13)


@pytest.mark.parametrize("formulation", tables.FORMULATIONS)
def test_cheap_search_ends_where_identify_does(formulation):
    tests = (1, 3, 4, 6, 8)
    found = subsets.fit((formulation, tests))
    samples = bench.table2().select(np.array(tests) - 1)
    served = hmcvt.identify(samples, formulation=formulation)
    assert found.objective == pytest.approx(served.objective, rel=2e-3)
    assert found.fit_error == pytest.approx(100.0 * served.fit_error, abs=0.02)


def summary(values, evaluations):
    runs = tuple(
        Run("x", seed, value, evaluations, 0.1, ((evaluations // 2, value),))
        for seed, value in enumerate(values)
    )
    return Summary("x", runs, 0.02)


def test_costs_are_per_run_that_arrives():
    half = summary([0.019, 0.03] * 5, 100)
    assert half.reached_text == "5 of 10"
    assert half.cost(half.whole) == "200"
    assert half.cost(half.until_met) == "150"  # by hand: (5 x 50 + 5 x 100) / 5
    none = summary([0.03] * 10, 100)
    assert none.cost(none.whole) == "never"
    assert half.median == pytest.approx(0.0245)
    assert summary([0.039, 0.041, 0.12], 100).astray == 2


def test_interrupted_work_goes_on_where_it_was(tmp_path):
    path, worked = tmp_path / "records.jsonl", []

    def work(number):
        worked.append(number)
        return {"number": number}

    with ThreadPoolExecutor(1) as pool:
        assert list(recorded(pool, work, {"a": 1}, path)) == [{"number": 1}]
        with path.open("a") as file:
            file.write('["b", {"num')  # cut off
        tasks = {"a": 1, "b": 2, "c": 3}
        for _ in range(2):
            found = list(recorded(pool, work, tasks, path))
            assert sorted(record["number"] for record in found) == [1, 2, 3]
    assert sorted(worked) == [1, 2, 3]

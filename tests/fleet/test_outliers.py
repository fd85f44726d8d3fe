# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Robust z scores and the table that shows them."""

import io
import re
import sys

import numpy as np
import pytest

from hmcvt_tools.cli.fleet import _Counter, _report
from hmcvt_tools.fleet.summary import (
    MIN_LOGS,
    THRESHOLD,
    record,
    robust_scores,
    summarise,
)

BROKEN = {"log": "x.csv", "error": "x.csv: is empty"}


def test_scores_by_hand():
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 100.0])
    found = robust_scores(values)
    # Median 5; distances 4 3 2 1 0 1 2 3 95, their median 2.
    assert found.median == 5.0 and found.deviation == pytest.approx(2.9652)
    assert found.z[-1] == pytest.approx(95.0 / 2.9652)
    assert (np.abs(found.z) > THRESHOLD).tolist() == [False] * 8 + [True]
    # Leakage is compared by its logarithm.
    again = robust_scores(1e-11 * 10.0**values, logarithmic=True)
    assert (again.median, again.deviation) == pytest.approx((1e-6, found.deviation))
    assert again.z == pytest.approx(found.z)


def test_odd_part_of_a_fleet_does_not_hide_itself():
    values = np.random.default_rng(0).normal(5.0, 0.2, 5000)
    assert robust_scores(values).deviation == pytest.approx(0.2, rel=0.05)
    assert np.mean(np.abs(robust_scores(values).z) > THRESHOLD) < 0.002
    values[:1000] += 10.0
    found = robust_scores(values)
    assert (np.abs(found.z) > THRESHOLD).tolist() == [True] * 1000 + [False] * 4000


@pytest.mark.parametrize(
    "values",
    [
        [1.0] * (MIN_LOGS - 2) + [9.0],  # too few
        [0.0] * 6 + [0.1, 0.2, 0.3, 0.4],  # most at a bound
        [0.1 + 1e-12 * i for i in range(12)],
    ],
)  # equal but for rounding
def test_fleet_without_scatter_is_not_judged(values):
    assert np.isnan(robust_scores(values).z).all()


def _row(number, leakage=1e-11, gap=0.004, verdict="no_gap", cause=None):
    spread = 1.0 + 0.01 * (number % 5)
    values = {"leakage": leakage, "motor_damping": 0.2, "pump_damping": 0.1}
    return record(
        {
            "log": f"{number:02d}.csv",
            "identification": {
                "parameters": {
                    name: {
                        "value": value * spread,
                        "unit": "",
                        "standard_error": 0.1 * value,
                    }
                    for name, value in values.items()
                }
            },
            "diagnosis": {
                "verdict": verdict,
                "gap": {"rmse": gap * spread},
                "causes": [{"effect": cause, "probability": 0.9}],
            },
        }
    )


def test_summary():
    rows = [_row(number) for number in range(10)]
    rows[3] = _row(3, leakage=2e-11)
    rows[7] = _row(7, gap=0.02, verdict="cause_found", cause="charge_pump")
    found = summarise(rows[:4], [*rows[:3:-1], BROKEN])
    assert [log["log"] for log in found["logs"]] == [
        f"{number:02d}.csv" for number in range(10)
    ]
    assert [log["outlier"] for log in found["logs"]] == [
        [],
        [],
        [],
        ["leakage"],
        [],
        [],
        [],
        ["gap"],
        [],
        [],
    ]
    assert found["counts"] == {
        "logs": 11,
        "finished_now": 6,
        "finished_before": 4,
        "broken": 1,
        "outliers": 2,
        "verdicts": {"no_gap": 9, "cause_found": 1},
        "causes": {"charge_pump": 1},
    }
    assert found["logs"][3]["z"]["leakage"] > 3.5 and found["logs"][3]["cause"] is None
    assert found["broken"] == [BROKEN]
    text = _report(found)
    assert re.search(
        r"\n00\.csv +1\.000e-11 +0\.2000 +0\.1000 +0\.40 +no_gap +- +-\n", text
    )
    assert re.search(
        r"07\.csv .* 2\.04 +cause_found +charge_pump \(90 %\) +gap \+\d", text
    )
    assert re.search(r"leakage +1\.02e-11 m3/\(s Pa\) +[\d.]+ decades +yes", text)
    assert "broken\n  x.csv: is empty\n" in text
    assert text.endswith(
        "11 logs: 6 finished now, 4 before, 1 broken; 2 outliers\n"
        "verdicts: no_gap 9, cause_found 1\ncauses: charge_pump 1"
    )


def test_progress_without_a_terminal(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    counter = _Counter("fleet", 60.0)
    counter.start = counter.last_line = counter.start - 600.0
    for number in range(9):
        counter.count(_row(number), 30)
    counter.count(BROKEN, 30)
    counter.close()
    shown = stream.getvalue()
    assert "hmcvt: broken: x.csv: is empty\n" in shown
    # One line a minute.
    assert "1 of 30 logs, 0 broken, about 291 min left" in shown
    assert shown.count(" of 30 logs") == 1
    assert re.search(r"fleet: 9 logs finished in 600\.\d s, 0\.01 logs/s\n$", shown)

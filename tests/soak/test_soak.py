# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The endurance trial in seconds: bounds that noise of a machine does not reach."""

import pytest

from studies.page import Run
from studies.soak import processes, report, trial

PLAN = trial.Plan(rate=100.0, seconds=0.5, turns=2, refit_turns=1, samples=20, rates=(100.0,),
                  rising_seconds=0.5, cycle=300)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("soak")
    processes.loopback_only(folder)
    return trial.under_load(PLAN, folder)


@pytest.mark.parametrize("when", ["steady", "refitting"])
def test_every_arrival_is_answered_rightly(loaded, when):
    for turn in getattr(loaded, when):
        segment = turn.node
        assert segment.right == segment.accepted
        if when == "steady":
            assert segment.answers == turn.node.answered == turn.node.accepted
        else:  # a new model answers once more, also shortly after the load
            assert segment.answers == segment.right + segment.repeats <= turn.node.answered
        assert turn.node.accepted >= 0.9 * segment.sent  # best effort, on a busy machine


def test_node_is_hardly_slower_than_a_bare_relay(loaded):
    segments = ([turn.node for turn in loaded.steady],
                [turn.relay for turn in loaded.steady])
    for percent in (50, 99):
        # What makes the node slow makes it slow in every turn.
        assert report.ratio(report.latency(percent), *segments).low < 5.0


def test_document_says_what_was_met(loaded):
    fuzzed = trial.Fuzzed(100, 50, 10, ("answer 3 is wrong",), 1.0, 0, True)
    kills = report.Kills("no problems", True)
    text = report.text(Run("command", 1.0, 0.0), PLAN, loaded, fuzzed, kills)
    rows = [line for line in text.splitlines() if line.endswith(("| met |", "| **missed** |"))]
    assert len(rows) == len(report.goals(loaded, fuzzed, kills, PLAN)) == 12
    assert "300 of 300" in text or "missed" in text
    assert "nan" not in text
    assert "wrong counts | 0 | 1 | **missed** |" in text

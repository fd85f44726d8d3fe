# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The endurance trial in seconds: counts and processor time, which a machine that stalls leaves."""

from subprocess import CompletedProcess

import pytest

from studies.page import Run
from studies.soak import processes, report, trial

pytestmark = pytest.mark.timeout(600)  # on a machine that stalls

PLAN = trial.Plan(
    rate=100.0,
    seconds=1.5,
    turns=2,
    refit_turns=1,
    samples=20,
    rates=(100.0,),
    rising_seconds=0.5,
    cycle=300,
    lossless=True,
)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("soak")
    processes.loopback_only(folder)
    return trial.under_load(PLAN, folder)


@pytest.mark.parametrize("when", ["steady", "refitting"])
def test_every_arrival_is_answered_rightly(loaded, when):
    for turn in getattr(loaded, when):
        segment = turn.node
        assert segment.right == segment.accepted == segment.sent
        # A new model answers once more, also shortly after the load.
        assert segment.answers == segment.right + segment.repeats
        # The last set is still fresh when the next one begins: all three of it are answered.
        assert when == "refitting" or (
            segment.repeats,
            segment.answered - segment.answers,
        ) in ((0, 0), (0, 2))


def test_node_works_hardly_more_than_a_bare_relay(loaded):
    def seconds_of_an_answer(parts):
        return sum(part.cpu * part.seconds for part in parts) / sum(
            part.answers for part in parts
        )

    node, relay = zip(*loaded.steady, strict=True)
    assert 0.0 < seconds_of_an_answer(node) < 3.0 * seconds_of_an_answer(relay)


def test_document_says_what_was_met(loaded):
    fuzzed = trial.Fuzzed(100, 50, 10, ("answer 3 is wrong",), 1.0, 0, True)
    kills = CompletedProcess([], 0, "no problems")
    text = report.text(Run("command", 1.0, 0.0), PLAN, loaded, fuzzed, kills)
    rows = [
        line
        for line in text.splitlines()
        if line.endswith(("| met |", "| **missed** |"))
    ]
    assert len(rows) == len(report.goals(loaded, fuzzed, kills, PLAN)) == 12
    assert "300 of 300" in text or "missed" in text
    assert "nan" not in text
    assert "wrong counts | 0 | 1 | **missed** |" in text

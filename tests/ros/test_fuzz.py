# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Nonsense (`make soak` sends 100,000 messages), and that what it is held to can be missed."""

import pytest
from rclpy.qos import QoSProfile

import hmcvt_core as hmcvt
from studies.soak import load, processes, trial
from studies.soak.fuzz_inputs import DEPTH, InputFuzzer, overrides

pytestmark = pytest.mark.usefixtures("environment")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_nonsense_does_not_make_the_node_break_a_promise(tmp_path):
    fuzzed = trial.nonsense(trial.Plan(fuzz=3_000), tmp_path)
    assert fuzzed.differences == ()
    assert fuzzed.survived and fuzzed.exit_code == 0
    assert fuzzed.sent >= 3_000 and fuzzed.answers > 300 and fuzzed.logged > 30


def test_fuzzer_notices_a_wrong_model(tmp_path):
    other = hmcvt.load_model(hmcvt.data_path("params/paper.yaml"))
    with (
        load.client() as here,
        processes.node("/wrong", tmp_path, **overrides("/wrong")) as node,
    ):
        target = load.Target(here, node, "/wrong", QoSProfile(depth=DEPTH))
        target.wait()
        fuzzer = InputFuzzer(target, other, seed=0, patience=2.0)
        fuzzer.run(100)
    assert fuzzer.differences[0].startswith("answer 0 of 1 is [0.")

# SPDX-License-Identifier: Apache-2.0
"""Diagnostics: levels, counts that add up, the input that lies outside the data."""

from __future__ import annotations

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, message

import hmcvt_core as hmcvt
from hmcvt_ros.messages import bench_sample_to_message

NAMES = ("displacement_ratio", "engine_speed", "load_torque")
INSIDE = GOOD._replace(engine_speed=100.0, load_torque=200.0)


@pytest.fixture(scope="module")
def model():
    return hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))


@pytest.fixture(scope="module")
def node(start_node):
    return start_node(hmcvt.data_path("params/hm4.yaml"), bench_log_limit=3)


def counts(node, subject, received):
    """Wait for a number of messages received and return how they were sorted."""
    player = node.player
    part = "model" if subject == "bench samples" else "inputs"

    def here():
        values = player.statuses.get(part, {"values": {}})["values"]
        return values.get(f"{subject} received") == str(received)

    assert player.wait_until(here, 5.0), player.statuses
    return {key.removeprefix(f"{subject} "): int(value)
            for key, value in player.statuses[part]["values"].items()
            if key.startswith((f"{subject} accepted", f"{subject} refused"))}


def test_inputs_received_are_those_accepted_and_those_refused(node):
    for name, publisher in zip(NAMES, node.player._inputs, strict=True):
        good = getattr(GOOD, name)
        for value in [good, math.nan, good, 9e9, good, -math.inf, good, math.nan]:
            publisher.publish(publisher.msg_type(data=value))
            node.player.spin_for(0.02)  # best effort: a burst may lose some
    for name in NAMES:
        assert counts(node, name, received=8) == {
            "accepted": 4, "refused, not finite": 3, "refused, out of range": 1}


def test_bench_samples_received_are_those_logged_and_those_refused(node, table2):
    unnamed = message(table2, 0)
    unnamed.name = ["a", "b", "c"]
    for sample in [unnamed, bench_sample_to_message(0.1, math.nan, 1.0, 1.0, 1.0),
                   *(message(table2, i) for i in range(5))]:
        node.player.send_sample(sample)
    assert counts(node, "bench samples", received=7) == {
        "accepted": 3, "refused, invalid": 2, "refused, log full": 2, "refused, not written": 0}
    status = node.player.statuses["model"]
    assert status["level"] == DiagnosticStatus.WARN and "takes no more" in status["message"]


def test_sample_that_cannot_be_written_is_an_error(start_node, paper_file, table2, tmp_path):
    (tmp_path / "file").write_text("")
    node = start_node(paper_file, state=tmp_path / "file" / "state")
    node.player.send_sample(message(table2, 0))
    assert counts(node, "bench samples", received=1)["refused, not written"] == 1
    assert node.player.statuses["model"]["level"] == DiagnosticStatus.ERROR


@pytest.mark.parametrize(("changes", "complaints"), [
    ({}, []),
    ({"engine_speed": 200.0},
     ["engine_speed 200 rad/s is not in 78.54 to 146.6 rad/s (750 to 1400 r/min)"]),
    ({"load_torque": 350.0},
     ["load_torque 350 N m is not in 101.9 to 292.9 N m"]),
    ({"engine_speed": 160.0, "load_torque": 90.0}, ["engine_speed 160", "load_torque 90"]),
])
def test_extrapolation_names_the_input_and_its_range(start_node, node, changes, complaints):
    point = INSIDE._replace(**changes)

    def told():
        node.player.send_inputs(point)
        values = node.player.statuses.get("model", {"values": {}})["values"]
        text = values.get("extrapolation", "")
        return all(word in text for word in complaints) and (text == "no") == (not complaints)

    assert node.player.wait_until(told, 5.0), node.player.statuses
    status = node.player.statuses["model"]
    for complaint in complaints:
        assert complaint in status["message"] and status["level"] == DiagnosticStatus.WARN
    assert ("extrapolation" in status["message"]) == bool(complaints)


def test_status_of_the_model_says_which_and_how_good(node, model):
    node.player.wait_until(lambda: "model" in node.player.statuses, 5.0)
    values = node.player.statuses["model"]["values"]
    assert values["fingerprint"] == model.fingerprint
    assert values["file"].endswith("hm4.yaml")
    assert float(values["fit error [-]"]) == model.provenance["fit_error"]
    assert (values["last refit"], values["last diagnosis"], values["running"]) == (
        "none", "none", "-")

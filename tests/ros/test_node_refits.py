# SPDX-License-Identifier: Apache-2.0
"""Bench samples are logged, the node refits itself from them, and goes back."""

from __future__ import annotations

import itertools
import json
import math
import os
import signal
import time

import numpy as np
import pytest
from ros_bench import GOOD, message, points, send_table

import hmcvt_core as hmcvt
from hmcvt_ros.messages import bench_sample_to_message


def relative_error(node, table2):
    answers = [node.player.hold(point, rounds=3).efficiency for point in points(table2)]
    return np.mean(np.abs(np.array(answers) / table2.efficiency - 1.0))


def test_refit_improves_and_revert_goes_back(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    before = relative_error(node, table2)

    reply = node.player.call("reidentify")
    assert reply.success, reply.data
    assert node.says(f"reidentify: {reply.data['file']} ({reply.data['model']}) in service")
    assert reply.data["samples"] == 8
    assert reply.data["error_before"] == pytest.approx(before, rel=1e-9)
    after = relative_error(node, table2)
    assert after < 0.02 < 0.2 < before
    assert reply.data["error_after"] == pytest.approx(after, rel=1e-6)
    assert "leakage" in reply.data["parameters"]

    # What the core makes of the same file is what the node serves now.
    refitted = hmcvt.identify(hmcvt.read_bench(node.bench_file), seed=0).model
    assert node.player.hold(GOOD).efficiency == pytest.approx(refitted.efficiency(*GOOD), rel=1e-9)
    assert node.player.wait_until(lambda: reply.data["model"] in node.player.model_text, 5.0)

    reply = node.player.call("revert")
    assert reply.success
    paper = hmcvt.load_model(paper_file)
    assert node.player.hold(GOOD).efficiency == paper.efficiency(*GOOD)
    reply = node.player.call("revert")
    assert not reply.success
    assert "none before" in reply.data["error"]


def test_refitted_model_survives_a_restart(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    fingerprint = node.player.call("reidentify").data["model"]
    assert node.stop() == 0
    again = start_node(paper_file, state=node.state)
    assert fingerprint in again.player.model_text
    assert again.player.wait_for_logged(8)
    assert again.player.call("revert").success


def test_no_message_is_dropped_while_the_model_is_swapped(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    old = node.player.hold(GOOD).efficiency
    node.player.efficiencies.clear()
    reply = node.player.request("reidentify")
    second = node.player.request("reidentify")
    sent = 0
    for _ in range(1000):
        node.player.send_inputs(GOOD)
        sent += 3
        node.player.spin_for(0.05)
        if reply.done() and second.done() and node.player.efficiencies[-1] != old:
            break
    node.player.spin_for(0.3)
    answers = [reply.result(), second.result()]
    assert sorted(answer.success for answer in answers) == [False, True]
    refused = next(answer for answer in answers if not answer.success)
    assert "busy: reidentify has been running for" in refused.message

    received = node.player.efficiencies
    swaps = sum(a != b for a, b in itertools.pairwise(received))
    assert swaps == 1 and received[0] == old
    # One more than sent: the swap itself is answered, the inputs being fresh.
    assert sent <= len(received) <= sent + 1


def test_bench_samples_are_logged_and_bad_ones_refused(start_node, paper_file, table2):
    node = start_node(paper_file, bench_log_limit=9)
    player = node.player
    for reply in (player.call("reidentify"), player.call("diagnose")):
        assert not reply.success
        assert "no bench samples" in reply.data["error"]
    send_table(player, table2)
    logged = hmcvt.read_bench(node.bench_file)
    np.testing.assert_allclose(logged.efficiency, table2.efficiency, rtol=1e-12)
    np.testing.assert_allclose(logged.load_torque, table2.load_torque, rtol=1e-12)
    np.testing.assert_array_equal(logged.engine_speed, table2.engine_speed)
    np.testing.assert_array_equal(logged.displacement_ratio, table2.displacement_ratio)
    sent = [message(table2, i).velocity[1] for i in range(8)]
    np.testing.assert_array_equal(logged.output_speed, sent)
    assert abs(logged.stamp[-1] - time.time()) < 60.0

    unnamed = message(table2, 0)
    unnamed.name = ["engine", "output", "lever"]
    bad = [
        unnamed,
        bench_sample_to_message(0.1, math.nan, 100.0, 80.0, 100.0),
        bench_sample_to_message(0.1, 100.0, 100.0, 80.0, 300.0),
        bench_sample_to_message(1.3, 100.0, 100.0, 80.0, 100.0),
    ]
    for refused in bad:
        player.send_sample(refused)

    def told():
        status = player.statuses["model"]
        return (status["values"].get("bench samples refused, invalid") == "4"
                and "bench_sample: displacement_ratio = 1.3 is outside" in status["message"])

    assert player.wait_until(told, 5.0), player.statuses["model"]
    player.send_sample(message(table2, 0))
    player.send_sample(message(table2, 1))
    assert player.wait_until(
        lambda: "takes no more" in player.statuses["model"]["message"], 5.0)
    assert len(hmcvt.read_bench(node.bench_file)) == 9


def test_clear_samples_begins_a_new_log_and_keeps_the_old(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    reply = node.player.call("clear_samples")
    assert reply.success and reply.data["cleared"] == 8
    assert len(hmcvt.read_bench(reply.data["kept_as"])) == 8
    for i in range(3):
        node.player.send_sample(message(table2, i))
    assert node.player.wait_until(
        lambda: node.player.statuses["model"]["values"]["bench samples logged"] == "3", 5.0)
    reply = node.player.call("reidentify")
    assert not reply.success
    assert "3 samples; reidentify_min_samples = 4" in reply.data["error"]


def test_samples_file_is_read_and_confined_to_the_state_folder(
    start_node, paper_file, table2, tmp_path
):
    state = tmp_path / "state"
    state.mkdir()
    hmcvt.write_bench(state / "mine.csv", table2)
    hmcvt.write_bench(tmp_path / "outside.csv", table2)
    (state / "link.csv").symlink_to(tmp_path / "outside.csv")
    node = start_node(paper_file, state=state, samples_file="mine.csv")
    reply = node.player.call("reidentify")
    assert reply.success and reply.data["samples"] == 8

    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    client = AsyncParameterClient(node.player, f"{node.namespace}/hmcvt")
    assert client.wait_for_services(10.0)
    for path in ("../outside.csv", str(tmp_path / "outside.csv"), "link.csv"):
        future = client.set_parameters([Parameter("samples_file", value=path)])
        assert node.player.wait_until(future.done, 10.0)
        reply = node.player.call("reidentify")
        assert not reply.success
        assert "outside the state folder" in reply.data["error"]


def test_diagnose_answers_with_the_contract_and_leaves_a_report(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)

    def value(key):
        status = node.player.statuses.get("model", {"values": {}})
        return status["values"].get(key)

    reply = node.player.request("diagnose")
    assert node.player.wait_until(
        lambda: "diagnose has been running for" in value("running"), 5.0)
    assert "busy" in node.player.call("reidentify").data["error"]
    assert node.player.wait_until(reply.done, 90.0)
    assert reply.result().success, reply.result().message
    found = json.loads(reply.result().message)
    assert {"gap", "where", "component", "verdict", "causes", "shrinkage", "next_tests"} <= set(
        found)
    assert found["gap"]["samples"] == 8

    page = node.state / "reports" / "0001.html"
    assert found["report"] == str(page)
    text = page.read_text()
    assert text.startswith("<!DOCTYPE html>") and text.rstrip().endswith("</html>")
    data = json.loads(page.with_suffix(".json").read_text())
    assert data == {key: found[key] for key in data} and data.keys() >= {"gap", "verdict"}
    assert node.says(f"diagnose: {found['verdict']}")
    assert f"report {page}" in node.log

    assert node.player.wait_until(lambda: value("gap verdict") == found["verdict"], 5.0)
    values = node.player.statuses["model"]["values"]
    assert values["running"] == "-"
    assert float(values["gap rmse [-]"]) == pytest.approx(found["gap"]["rmse"], rel=1e-3)
    leading = found["causes"][0]["effect"] if found["causes"] else "-"
    assert values["gap leading cause"].startswith(leading)
    fraction = found["shrinkage"]["fraction"]
    assert values["gap shrinkage [-]"] == ("-" if fraction is None else f"{fraction:.3f}")
    assert values["gap of model"] == hmcvt.load_model(paper_file).fingerprint
    assert values["report"] == str(page)
    assert values["gap diagnosed"].endswith("Z, 8 samples")


def test_report_that_cannot_be_written_costs_the_report_only(start_node, paper_file, table2):
    node = start_node(paper_file)
    (node.state / "reports").write_text("a file where the folder should be")
    send_table(node.player, table2)
    reply = node.player.call("diagnose", timeout=90.0)
    assert reply.success and reply.data["report"] is None
    assert "reports" in reply.data["report_error"]
    assert node.says("report not written")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ends_cleanly_in_the_middle_of_a_refit(start_node, paper_file, table2, number):
    node = start_node(paper_file)
    send_table(node.player, table2)
    node.player.request("reidentify")
    assert node.player.wait_until(lambda: bool(node.children()), 5.0)
    workers = node.children()
    asked = time.monotonic()
    assert node.stop(number) == 0, node.log
    assert time.monotonic() - asked < 3.0
    assert "Traceback" not in node.log
    assert not any(alive(pid) for pid in workers)


def test_worker_does_not_outlive_a_killed_node(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    node.player.request("diagnose")
    assert node.player.wait_until(lambda: bool(node.children()), 5.0)
    workers = node.children()
    node.stop(signal.SIGKILL)
    assert node.player.wait_until(lambda: not any(map(alive, workers)), 5.0)


def test_worker_is_kept_and_replaced_when_it_dies(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    for _ in range(2):
        assert node.player.call("reidentify").success
    worker, = node.children()
    assert alive(worker)

    reply = node.player.request("diagnose")
    node.player.spin_for(0.2)  # it takes a second
    os.kill(worker, signal.SIGKILL)
    assert node.player.wait_until(reply.done, 5.0)
    assert "the worker process ended with status -9" in reply.result().message

    assert node.player.call("reidentify").success
    other, = node.children()
    assert other != worker
    os.kill(other, signal.SIGKILL)  # while it has nothing to do
    # Its pipe closes with the last of its threads.
    assert node.player.wait_until(
        lambda: not alive(other) and len(os.listdir(f"/proc/{other}/task")) == 1, 5.0)
    assert node.player.call("reidentify").success


def alive(pid):
    """Whether a process runs; one that is dead but not yet collected does not."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False

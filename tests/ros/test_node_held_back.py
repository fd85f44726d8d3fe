# SPDX-License-Identifier: Apache-2.0
"""A refit that is worse than the model in service on samples held back stays out of service."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ros_bench import GOOD, send_table

import hmcvt_core as hmcvt


@pytest.fixture(scope="module")
def good_file():
    return hmcvt.data_path("params/hm4.yaml")


@pytest.fixture(scope="module")
def spoiled(table2):
    """Table 2 with one reading that is far too low."""
    return replace(table2, efficiency=table2.efficiency - 0.4 * (np.arange(8) == 4))


def test_worse_refit_is_refused_and_kept_as_a_candidate(start_node, good_file, table2, spoiled):
    node = start_node(good_file)
    served = hmcvt.load_model(good_file)
    send_table(node.player, spoiled)
    before = node.player.model_text

    reply = node.player.call("reidentify")
    assert not reply.success
    compared = reply.data["held_back"]
    assert compared["samples"] == 8
    expected = np.mean(np.abs(served.efficiency(
        table2.displacement_ratio, table2.engine_speed, table2.load_torque) / spoiled.efficiency
        - 1.0))
    assert compared["error_in_service"] == pytest.approx(expected, rel=1e-9)
    assert compared["error_refit"] > compared["error_in_service"] + compared["allowance"]
    assert reply.data["samples"] == 8 and "leakage" in reply.data["parameters"]

    # The reason names both figures and the file, in the answer, the log and diagnostics.
    candidate = node.state / "candidates" / "0001.yaml"
    assert reply.data["candidate"] == str(candidate)
    for word in ("worse on samples held back", f"{100 * compared['error_refit']:.2f} %",
                 f"{100 * compared['error_in_service']:.2f} %", str(candidate)):
        assert word in reply.data["error"]
    assert node.says(f"reidentify: {reply.data['error']}")
    warning = next(line for line in node.log.splitlines() if "samples held back" in line)
    assert "[WARN]" in warning
    assert node.player.wait_until(
        lambda: "not adopted: the refit is worse" in node.player.statuses.get(
            "model", {"values": {"last refit": ""}})["values"]["last refit"], 5.0)

    # The refit to all samples is there to be looked at; nothing of the service has changed.
    refit = hmcvt.identify(hmcvt.read_bench(node.bench_file), stage=served.stage).model
    assert hmcvt.load_model(candidate).fingerprint == refit.fingerprint
    assert node.player.model_text == before
    assert node.player.hold(GOOD).efficiency == served.efficiency(*GOOD)
    assert list((node.state / "models").iterdir()) == []
    assert not node.player.call("revert").success


@pytest.fixture(scope="module")
def node(start_node, paper_file, table2):
    node = start_node(paper_file)
    send_table(node.player, table2)
    return node


def test_refit_tells_how_it_did_on_samples_held_back(node):
    reply = node.player.call("reidentify")
    assert reply.success, reply.data
    compared = reply.data["held_back"]
    assert set(compared) == {"samples", "folds", "error_refit", "error_in_service", "allowance",
                             "change"}
    assert compared["error_in_service"] == pytest.approx(reply.data["error_before"], rel=1e-9)
    assert reply.data["error_after"] < compared["error_refit"] < 0.1

    # The same once more gives the same model, which is no reason to refuse it.
    again = node.player.call("reidentify")
    assert again.success and again.data["model"] == reply.data["model"]
    assert again.data["held_back"]["change"] == pytest.approx(0.0, abs=1e-9)


def test_refit_is_not_adopted_over_a_model_it_was_not_compared_with(node):
    running = node.player.request("reidentify")
    assert node.player.wait_until(lambda: bool(node.children()), 5.0)
    reverted = node.player.call("revert")
    assert reverted.success
    assert node.player.wait_until(running.done, 30.0)
    assert not running.result().success
    assert "changed meanwhile" in running.result().message
    assert reverted.data["model"] in node.player.model_text


def test_few_samples_are_adopted_unchecked_and_say_so(start_node, paper_file, table2):
    node = start_node(paper_file, reidentify_min_samples=3)
    send_table(node.player, table2.select([0, 2, 5]))
    reply = node.player.call("reidentify")
    assert reply.success and reply.data["held_back"] is None
    assert any("none could be held back" in warning for warning in reply.data["warnings"])

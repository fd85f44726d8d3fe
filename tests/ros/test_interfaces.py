# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The messages and actions of hmcvt_msgs: built here, taken by a node, and answered."""

import importlib
import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from ros_bench import GOOD, send_table

import hmcvt_core as hmcvt
from hmcvt_ros import interfaces, qos
from hmcvt_ros.actions import diagnose_result, refit_result
from hmcvt_ros.services import Reply

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
OIL_FREE = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """The messages, as the generators of ROS and a compiler make them."""
    if shutil.which("gcc") is None or shutil.which("g++") is None:
        pytest.skip("needs gcc and g++")
    pytest.importorskip("rosidl_generator_py")
    folder = tmp_path_factory.mktemp("interfaces")
    subprocess.run(
        [sys.executable, str(ROOT / "tests/ros/build_interfaces.py"), str(folder)],
        check=True,
    )
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(folder), before)))
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    for name in [name for name in sys.modules if name.split(".")[0] == "hmcvt_msgs"]:
        del sys.modules[name]  # the folder of the checkout
    yield importlib.import_module("hmcvt_msgs.msg")
    sys.path.remove(str(folder))
    os.environ["PYTHONPATH"] = before


@pytest.fixture(scope="module")
def typed_node(messages, start_node):
    return start_node(hmcvt.data_path("params/hm4.yaml"), input_timeout=10.0)


@pytest.fixture(scope="module")
def ask(messages, typed_node):
    """Send an OperatingPoint; return the Advice."""
    player = typed_node.player
    asked = player.create_publisher(
        messages.OperatingPoint, "hmcvt/operating_point", qos.INPUT
    )
    heard = []
    player.create_subscription(
        messages.Advice, "hmcvt/advice", heard.append, qos.OUTPUT
    )
    assert typed_node.comes(
        lambda: (
            asked.get_subscription_count() and player.count_publishers("hmcvt/advice")
        ),
        20.0,
    )

    def ask(**fields):
        for number in range(10):  # best effort
            heard.clear()
            sent = messages.OperatingPoint(**fields)
            sent.header.stamp.nanosec = number
            asked.publish(sent)
            if typed_node.comes(lambda: heard, 5.0):
                assert heard[-1].header.stamp.nanosec == number
                return heard[-1]
        raise TimeoutError

    return ask


def test_checkout_is_not_taken_for_the_package(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "hmcvt_msgs"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "path", [str(ROOT), *sys.path])
    importlib.invalidate_caches()
    assert interfaces.find("msg", "Advice") is None


def test_point_is_answered_as_the_model_does(ask):
    answer = ask(id="shift 7", **GOOD._asdict())
    expected = OIL_FREE.predict(*GOOD)
    best = OIL_FREE.optimal_displacement_ratio(*GOOD[1:])
    assert answer.id == "shift 7"
    assert answer.model == OIL_FREE.fingerprint
    assert answer.stage == OIL_FREE.stage.name == answer.optimal_stage
    assert answer.hold == answer.ENGINE_SPEED
    assert answer.efficiency == expected.efficiency
    assert answer.efficiency_std == expected.standard_error
    assert answer.power_loss == OIL_FREE.power_loss(*GOOD)
    assert answer.optimal_displacement_ratio == best.displacement_ratio
    assert answer.extrapolated is not bool(expected.inside_domain)
    assert math.isnan(answer.fuel_rate)
    assert answer.refusal == ""


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engine_speed": 1500.0}, "engine_speed = 1500 is outside 10 to 320 rad/s"),
        ({"displacement_ratio": math.nan}, "is not finite"),
        ({"load_torque": 0.0}, "coasting"),
        ({"oil_temperature": [340.0]}, "oil_temperature = 340 is outside"),
    ],
)
def test_point_without_an_answer_states_why(ask, changes, words):
    answer = ask(id="bad", **{**GOOD._asdict(), **changes})
    assert answer.id == "bad"
    assert math.isnan(answer.efficiency)
    assert math.isnan(answer.optimal_displacement_ratio)
    assert words in answer.refusal


def test_sample_is_logged_with_all_that_it_states(messages, typed_node):
    player = typed_node.player
    sender = player.create_publisher(
        messages.BenchSample, "hmcvt/bench_sample", qos.BENCH_SAMPLE
    )
    assert typed_node.comes(sender.get_subscription_count, 20.0)
    sample = messages.BenchSample(
        displacement_ratio=0.5,
        engine_speed=150.0,
        engine_torque=200.0,
        output_speed=100.0,
        output_torque=240.0,
    )
    sample.header.stamp.sec = 1000
    sender.publish(sample)
    sample.header.stamp.sec = 1060
    sample.efficiency_std = [0.002]
    sample.oil_temperature = [71.0]
    sample.pressure = [2e7]
    sample.charge_pressure = [2.2e6]
    sample.session = [3]
    sender.publish(sample)
    sample.header.stamp.sec = 1120
    sample.engine_speed = 0.0
    sender.publish(sample)
    assert typed_node.comes(lambda: typed_node.logged() == 2, 20.0)
    bench = hmcvt.read_bench(typed_node.bench_file)
    assert bench.efficiency.tolist() == pytest.approx([0.8, 0.8])
    assert bench.extra["stated_std"] == ("", "0.002")
    assert bench.extra["stated_oil_temperature"] == ("", "71.0")
    assert bench.extra["stated_pressure"] == ("", "20000000.0")
    assert bench.extra["stated_charge_pressure"] == ("", "2200000.0")
    assert bench.extra["stated_session"] == ("", "3")
    assert typed_node.says("engine speed 0 rad/s must be positive")


class ActionUnderTest:
    """A client of an action, and the feedback that it has heard."""

    def __init__(self, node, kind, name):
        self.node = node
        self.kind = kind
        self.feedback = []
        self.client = ActionClient(node.player, kind, f"{node.namespace}/hmcvt/{name}")
        assert node.comes(self.client.server_is_ready, 20.0)

    def send(self):
        """Send a goal; return its handle."""
        return self.wait(
            self.client.send_goal_async(
                self.kind.Goal(),
                feedback_callback=lambda heard: self.feedback.append(heard.feedback),
            )
        )

    def wait(self, future):
        assert self.node.comes(future.done, 100.0)
        return future.result()

    def result(self, goal):
        """Return status and result of a goal."""
        response = self.wait(goal.get_result_async())
        return response.status, response.result


@pytest.fixture(scope="module")
def actions(messages, start_node, paper_file, table2):
    """A node with eight samples, and clients of its actions."""
    kinds = importlib.import_module("hmcvt_msgs.action")
    node = start_node(paper_file)
    send_table(node, table2)
    return (
        node,
        ActionUnderTest(node, kinds.Refit, "reidentify"),
        ActionUnderTest(node, kinds.Diagnose, "diagnose"),
    )


def test_goal_refits_as_the_service_does(actions):
    node, refit, _ = actions
    status, result = refit.result(refit.send())
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert result.outcome == result.ADOPTED
    served = hmcvt.load_model(node.state / result.file)
    assert result.model == served.fingerprint
    assert node.comes(lambda: node.value("fingerprint") == result.model)
    assert result.samples == 8
    assert result.error_after < result.error_before
    reply = json.loads(result.reply)
    assert reply["largest_change"] == result.largest_change
    assert refit.feedback[0].state == "started"
    assert refit.feedback[-1].state == "done"
    assert node.player.call("revert").success


def test_goal_diagnoses_and_writes_the_report(actions):
    node, _, diagnose = actions
    status, result = diagnose.result(diagnose.send())
    assert status == GoalStatus.STATUS_SUCCEEDED
    page = node.state / result.report
    written = json.loads(page.with_suffix(".json").read_text())
    assert result.verdict == written["verdict"]
    assert json.loads(result.reply)["sets"] == written["sets"]
    assert page.is_file()
    assert result.reason == ""


def test_results_hold_what_the_replies_do(messages):
    kinds = importlib.import_module("hmcvt_msgs.action")
    first = {"effects": ["clutch_drag", "leakage"], "probability": 0.6}
    reply = {"verdict": "ambiguous", "sets": [first, {"effects": []}], "report": None}
    result = diagnose_result(kinds.Diagnose.Result, Reply(True, json.dumps(reply)))
    assert result.effects == first["effects"]
    assert result.probability == 0.6
    assert result.report == ""
    reply = {"error": "too far", "candidate": "candidates/0001.yaml", "samples": 9}
    result = refit_result(kinds.Refit.Result, Reply(False, json.dumps(reply)))
    assert (result.outcome, result.reason) == (result.REFUSED, "too far")
    assert result.file == "candidates/0001.yaml"
    reply = {"staged": True, "doubt": "it drifts", "model": "ab", "file": "m.yaml"}
    result = refit_result(kinds.Refit.Result, Reply(True, json.dumps(reply)))
    assert (result.outcome, result.reason) == (result.STAGED, "it drifts")
    assert math.isnan(result.error_before)


def test_goal_that_is_cancelled_ends_its_job(actions):
    node, _, diagnose = actions
    diagnose.feedback.clear()
    goal = diagnose.send()
    assert node.comes(lambda: diagnose.feedback)
    cancelling = diagnose.wait(goal.cancel_goal_async())
    assert cancelling.return_code == CancelGoal.Response.ERROR_NONE
    status, result = diagnose.result(goal)
    assert status == GoalStatus.STATUS_CANCELED
    assert result.verdict == ""
    assert "its goal was cancelled" in result.reason
    assert node.comes(lambda: node.value("running") == "-")


def test_goal_that_is_cancelled_at_once_ends_early(actions):
    _, _, diagnose = actions
    goal = diagnose.send()
    diagnose.wait(goal.cancel_goal_async())
    status, _ = diagnose.result(goal)
    assert status == GoalStatus.STATUS_CANCELED


def test_goal_beside_a_job_is_rejected(actions):
    node, refit, diagnose = actions
    running = node.running("diagnose")
    assert not refit.send().accepted
    assert not diagnose.send().accepted
    assert node.says("a goal is rejected: busy: diagnose has been running")
    assert node.player.call("cancel").success
    diagnose.wait(running)


def test_job_of_a_goal_is_ended_by_the_service(actions):
    node, _, diagnose = actions
    diagnose.feedback.clear()
    goal = diagnose.send()
    assert node.comes(lambda: diagnose.feedback)
    assert node.player.call("cancel").success
    status, result = diagnose.result(goal)
    assert status == GoalStatus.STATUS_ABORTED
    assert "ended by ~/cancel" in result.reason


def test_refit_without_samples_is_aborted_with_the_reason(actions, table2):
    node, refit, _ = actions
    assert node.player.call("clear_samples").success
    status, result = refit.result(refit.send())
    assert status == GoalStatus.STATUS_ABORTED
    assert result.outcome == result.FAILED
    assert "no bench samples logged" in result.reason
    assert math.isnan(result.error_after)


def test_node_with_a_goal_under_way_ends_in_order(actions, table2):
    node, _, diagnose = actions
    send_table(node, table2)
    diagnose.feedback.clear()
    diagnose.send()
    assert node.comes(lambda: diagnose.feedback)
    assert node.stop() == 0
    assert "Traceback" not in node.log
    assert "InvalidHandle" not in node.log

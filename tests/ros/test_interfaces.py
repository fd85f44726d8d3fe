# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The messages of hmcvt_msgs: built here, taken by a node, and answered as the standard ones."""

import importlib
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from ros_bench import GOOD

import hmcvt_core as hmcvt
from hmcvt_ros import interfaces, qos

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
    assert interfaces.find() is None


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
    assert bench.extra["stated_session"] == ("", "3")
    assert typed_node.says("engine speed 0 rad/s must be positive")

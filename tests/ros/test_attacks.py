# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""No message, request or clock from outside ends the node, holds it up, or makes it say old things.

One node for all, with a clock and a main thread that the tests take hold of.
"""

import math
import os
import signal
import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces import srv
from rcl_interfaces.msg import Parameter, ParameterValue
from ros_bench import GOOD, Shim
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from type_description_interfaces.srv import GetTypeDescription

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_ros import qos
from hmcvt_ros.outputs import ADVICE

pytestmark = pytest.mark.slow

BAD_TYPE = Parameter(name="input_timeout", value=ParameterValue(type=99))
GOOD_VALUE = Parameter(
    name="input_timeout", value=ParameterValue(type=3, double_value=0.4)
)
LONG = "x" * 5_000_000


@pytest.fixture(scope="module")
def attacked(start_node, paper_file, tmp_path_factory):
    """A node and what gives orders to its clock."""
    shim = Shim(tmp_path_factory.mktemp("shim"))
    node = start_node(paper_file, launcher=shim.launcher)
    yield node, shim
    assert node.stop() == 0


@pytest.fixture
def node(attacked):
    attacked[0].reset()
    return attacked[0]


def answers(node):
    return node.process.poll() is None and node.player.hold(GOOD).efficiency is not None


def counted(node, *keys):
    """Counts of the inputs' status, from diagnostics that come from now on."""
    node.forget_status()
    assert node.comes(lambda: "inputs" in node.player.statuses)
    found = [int(node.value(key, "inputs")) for key in keys]
    return found[0] if len(found) == 1 else found


def flow(node, seconds):
    """Hold a point."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        node.player.send_inputs(GOOD)
        node.player.spin_for(0.02)


# --- requests to what rclpy serves ----------------------------------------------------------------


def test_parameter_of_an_unknown_type_is_refused(node):
    before = counted(node, "requests contained")
    results = node.call(
        srv.SetParameters, "set_parameters", parameters=[BAD_TYPE, GOOD_VALUE]
    ).results
    assert [result.successful for result in results] == [False, True]
    assert "99" in results[0].reason
    result = node.call(
        srv.SetParametersAtomically,
        "set_parameters_atomically",
        parameters=[GOOD_VALUE, BAD_TYPE],
    ).result
    assert not result.successful and "99" in result.reason
    assert answers(node) and node.says("99 is not a valid")
    assert counted(node, "requests contained") == before + 2


def test_parameter_without_a_name_is_refused(node):
    for kind in range(10):
        (result,) = node.call(
            srv.SetParameters,
            "set_parameters",
            parameters=[
                Parameter(name="", value=ParameterValue(type=kind, string_value="x"))
            ],
        ).results
        assert not result.successful and result.reason == "a parameter without a name"
    assert "" not in node.call(srv.ListParameters, "list_parameters").result.names


def test_large_request_is_refused_and_holds_nothing_up(node):
    before, size = counted(node, "requests contained"), len(node.log)
    text = Parameter(
        name="samples_file", value=ParameterValue(type=4, string_value=LONG)
    )
    many = ["input_timeout"] * 5000
    for kind, service, request in [
        (srv.SetParameters, "set_parameters", {"parameters": [GOOD_VALUE] * 5000}),
        (srv.SetParameters, "set_parameters", {"parameters": [text]}),
    ]:
        results = node.call(kind, service, **request).results
        assert len(results) == len(request["parameters"])
        assert not any(result.successful for result in results)
        assert "allowed are" in results[0].reason
    result = node.call(
        srv.SetParametersAtomically,
        "set_parameters_atomically",
        parameters=[GOOD_VALUE] * 5000,
    ).result
    assert not result.successful and "5000 entries; allowed are 100" in result.reason
    for kind, service, request in [
        (srv.GetParameters, "get_parameters", {"names": many}),
        (srv.GetParameterTypes, "get_parameter_types", {"names": [LONG]}),
        (srv.DescribeParameters, "describe_parameters", {"names": many}),
        (srv.ListParameters, "list_parameters", {"prefixes": many}),
        (GetTypeDescription, "get_type_description", {"type_name": LONG}),
    ]:
        node.call(kind, service, **request)
    assert answers(node)
    assert counted(node, "requests contained") == before + 8
    assert len(node.log) - size < 5000


def test_refused_services_do_not_fill_the_log(node):
    size = len(node.log)  # nobody has called them before
    for service in ("adopt", "cancel") * 100:
        assert not node.player.call(service).success
    assert 0 < len(node.log) - size < 1000


def test_clock_of_the_ages_cannot_be_exchanged(node):
    (result,) = node.set(use_sim_time=True)
    assert not result.successful and "read-only" in result.reason
    for kind in (0, 1):  # to take a parameter away is a change too
        (result,) = node.call(
            srv.SetParameters,
            "set_parameters",
            parameters=[
                Parameter(name="use_sim_time", value=ParameterValue(type=kind))
            ],
        ).results
        assert not result.successful
    assert answers(node)


def test_clock_of_no_time_is_ignored_and_told(sim_node):
    clock = sim_node.player.create_publisher(Clock, "/clock", 1)
    assert sim_node.comes(clock.get_subscription_count)
    message = Clock()
    message.clock.sec = -5

    def counted_one():
        clock.publish(message)
        return int(sim_node.value("requests contained", "inputs") or 0) > 0

    assert sim_node.comes(counted_one), sim_node.log
    assert sim_node.says("/clock is ignored: ValueError: ")
    assert answers(sim_node)
    sim_node.player.destroy_publisher(clock)


def test_broken_or_huge_message_is_refused(node):
    ends = [
        node.player.create_publisher(JointState, f"{node.namespace}/{topic}", 10)
        for topic in ("operating_point", "bench_sample")
    ]
    keys = (
        ("inputs", "operating points refused, invalid"),
        ("model", "bench samples refused, invalid"),
    )
    counts = [
        int(node.value(key, part))
        for part, key in keys
        if node.comes(lambda part=part: part in node.player.statuses)
    ]
    for end in ends:
        assert node.comes(end.get_subscription_count)
        for sent in (
            JointState(name=["engine"] * 2000),
            b"\x00\x01\x00\x00" + 5 * b"\xff",
        ):
            end.publish(sent)
    for (part, key), before in zip(keys, counts, strict=True):
        assert node.comes(
            lambda part=part, key=key, before=before: (
                int(node.value(key, part)) == before + 2
            )
        ), (node.value(key, part), before, node.log)
    assert answers(node)
    for end in ends:
        node.player.destroy_publisher(end)


# --- clocks and stalls ----------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["stalled", "stopped"])
def test_stalled_node_does_not_answer_from_old_inputs(attacked, node, how):
    node.set(input_timeout=0.3)
    assert answers(node)
    if how == "stalled":
        attacked[1].stall(1.0)
        node.player.spin_for(0.2)
    else:
        os.kill(node.process.pid, signal.SIGSTOP)
    node.player.efficiencies.clear()
    for _ in range(5):  # they wait in the queue until it goes on
        node.player.send_inputs(GOOD)
        node.player.spin_for(0.02)
    node.player.spin_for(1.2)
    os.kill(node.process.pid, signal.SIGCONT)
    node.player.spin_for(0.5)
    assert node.player.efficiencies == []
    assert answers(node)


def test_system_clock_that_is_set_does_no_harm(attacked, node):
    keys = "clock jumps", "load_torque received", "points answered"
    assert answers(node)
    before = counted(node, *keys)
    node.player.spin_for(0.6)
    for seconds in (-30, 3600, 0):
        flow(node, 0.3)
        attacked[1].set_clock(seconds)
    flow(node, 0.3)
    jumps, sent, answered = (
        new - old for new, old in zip(counted(node, *keys), before, strict=True)
    )
    assert jumps == 3
    # The first two are no set yet, and a busy machine may lose one of those that are best effort.
    assert answered >= 3 * sent - 12 > 10


# --- what is daily life, and what does not belong together ----------------------------------------


def reported(node, point, level, *words):
    return node.reports(level, *words, part="inputs", send=point)


def test_coasting_is_silence_and_no_trouble(node):
    before = counted(node, "points not answered, coasting")
    for torque in (0.9, 0.0, -250.0):
        assert (
            node.player.hold(GOOD._replace(load_torque=torque), patience=0.0).efficiency
            is None
        )
    point = GOOD._replace(load_torque=-250.0)
    assert reported(
        node, point, DiagnosticStatus.OK, "load_torque = -250 N m: coasting"
    )
    assert node.value("load_torque state", "inputs") == "coasting"
    assert int(node.value("points not answered, coasting", "inputs")) > before
    assert answers(node)


def test_stroke_a_hair_beyond_one_is_taken_as_one(node, paper_file):
    model = hmcvt.load_model(paper_file)
    for stroke, limit in ((1.001, 1.0), (-1.02, -1.0)):
        found = node.player.hold(GOOD._replace(displacement_ratio=stroke)).efficiency
        assert found == model.efficiency(*GOOD._replace(displacement_ratio=limit))
    assert reported(node, GOOD._replace(displacement_ratio=1.001), DiagnosticStatus.OK)
    assert int(node.value("displacement_ratio taken as the limit", "inputs")) > 0
    assert reported(
        node,
        GOOD._replace(displacement_ratio=1.03),
        DiagnosticStatus.ERROR,
        "displacement_ratio = 1.03 is outside -1 to 1",
    )


def test_inputs_of_different_times_are_not_answered(node):
    node.set(max_input_skew=0.1, input_timeout=5.0)
    assert answers(node)
    before = counted(node, "points not answered, inputs apart")
    node.player.efficiencies.clear()
    stroke, *_ = node.player._inputs
    stroke.publish(Float64(data=0.5))
    assert node.comes(
        lambda: (
            "s older than displacement_ratio; max_input_skew = 0.1"
            in node.status("inputs")["message"]
        )
    ), node.status("inputs")
    assert node.status("inputs")["level"] == DiagnosticStatus.WARN
    assert int(node.value("points not answered, inputs apart", "inputs")) == before + 1
    assert node.player.efficiencies == []
    assert answers(node)


# --- answers that say what they belong to ---------------------------------------------------------


def test_advice_answers_each_operating_point_with_its_stamp(node, paper_file):
    model = hmcvt.load_model(hmcvt.data_path("params/paper.yaml"))
    heard = []
    publisher = node.player.create_publisher(
        JointState, f"{node.namespace}/operating_point", qos.INPUT
    )
    speeds = []
    ends = [
        node.player.create_subscription(JointState, "advice", heard.append, qos.OUTPUT),
        node.player.create_subscription(
            Float64,
            "optimal_engine_speed",
            lambda message: speeds.append(message.data),
            qos.OUTPUT,
        ),
    ]
    assert node.comes(
        lambda: (
            publisher.get_subscription_count()
            and node.player.count_publishers(f"{node.namespace}/advice")
        )
    )

    def advice(second, *changed):
        message = bench_sample_to_message(
            *(changed or (0.5, 100.0, math.nan, 80.0, 250.0))
        )
        message.header.stamp.sec = second
        for _ in range(3):  # best effort
            publisher.publish(message)
            if node.comes(lambda: heard and heard[-1].header.stamp.sec == second, 2.0):
                break
        assert list(heard[-1].name) == list(ADVICE)
        assert heard[-1].header.frame_id == f"{model.fingerprint}:HM4"
        return dict(zip(heard[-1].name, heard[-1].position, strict=True))

    found = advice(17)  # 250 N m x 80 rad/s at 100 rad/s: 200 N m
    assert found["efficiency"] == model.efficiency(*GOOD)
    assert found["hold"] == 0.0  # engine_speed
    assert node.set(optimum_hold="output_speed")[0].successful
    assert advice(118)["hold"] == 1.0
    assert node.set(optimum_hold="engine_speed")[0].successful
    found = advice(119)
    assert found["power_loss"] == pytest.approx(20e3 / found["efficiency"] - 20e3)
    assert (
        found["optimal_displacement_ratio"]
        == model.optimal_displacement_ratio(100.0, 200.0).displacement_ratio
    )
    assert found["optimal_engine_speed"] == 100.0
    assert math.isnan(found["fuel_rate"])
    node.set(optimum_hold="output_speed")
    best = model.optimal_displacement_ratio(
        100.0,
        200.0,
        hold="output_speed",
        displacement_ratio=0.5,
        engine_speed_limits=(78.54, 230.38),
    )
    found = advice(18)
    assert found["optimal_engine_speed"] == best.engine_speed
    assert node.player.hold(GOOD).optimal_displacement_ratio == best.displacement_ratio
    assert speeds[-1] == best.engine_speed
    for number, wrong in enumerate(
        (
            (1.3, 100.0, math.nan, 80.0, 250.0),
            (0.5, 100.0, math.nan, 80.0, 0.0),
            (0.5, math.nan, 1.0, 80.0, 250.0),
            (0.5, 100.0, math.nan, math.nan, 250.0),
        )
    ):
        assert all(map(math.isnan, advice(20 + number, *wrong).values())), wrong
    assert advice(30, 1.001, 100.0, math.nan, 80.0, 250.0)["efficiency"] > 0.0
    for end in ends:
        node.player.destroy_subscription(end)
    node.player.destroy_publisher(publisher)


def test_client_that_sends_operating_points_alone_lacks_nothing(start_node, paper_file):
    node = start_node(paper_file)
    publisher = node.player.create_publisher(
        JointState, f"{node.namespace}/operating_point", qos.INPUT
    )

    def told(level, words, torque, stroke=0.5):
        message = bench_sample_to_message(stroke, 100.0, math.nan, 80.0, torque)

        def found():
            publisher.publish(message)
            status = node.status("inputs")
            return status["level"] == level and words in status["message"]

        node.forget_status()
        assert node.comes(found), node.status("inputs")

    told(DiagnosticStatus.OK, "operating points", 250.0)
    for torque in (0.0, -50.0):
        told(
            DiagnosticStatus.OK,
            f"operating_point: load_torque = {torque * 0.8:g} N m: coasting",
            torque,
        )
    assert int(node.value("points not answered, coasting", "inputs")) > 0
    assert node.value("operating points refused, invalid", "inputs") == "0"
    told(
        DiagnosticStatus.ERROR,
        "operating_point: displacement_ratio = 1.3 is outside",
        250.0,
        1.3,
    )
    node.forget_status()
    assert node.comes(lambda: node.status("inputs")["level"] == DiagnosticStatus.WARN)
    node.player.destroy_publisher(publisher)
    assert node.stop() == 0

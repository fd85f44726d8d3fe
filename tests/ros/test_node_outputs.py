# SPDX-License-Identifier: Apache-2.0
"""What the outputs do: NaN where asked for, age limits of single inputs, never an old optimum."""

from __future__ import annotations

import math

import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from ros_bench import GOOD, send_table

import hmcvt_core as hmcvt
from hmcvt_ros.parameters import PARAMETERS

STALLED = GOOD._replace(displacement_ratio=-1.0, engine_speed=20.0, load_torque=5000.0)


def change(node, name, value):
    """Set a parameter of the running node."""
    client = AsyncParameterClient(node.player, f"{node.namespace}/hmcvt")
    assert client.wait_for_services(10.0)
    future = client.set_parameters([Parameter(name, value=value)])
    assert node.player.wait_until(future.done, 10.0)
    return future.result().results[0]


def collected(player, seconds):
    """What the outputs say within a while."""
    player.efficiencies.clear()
    player.optima.clear()
    player.spin_for(seconds)
    return list(player.efficiencies), list(player.optima)


@pytest.fixture(scope="module")
def model(paper_file):
    return hmcvt.load_model(paper_file)


@pytest.fixture(scope="module")
def nan_node(start_node, paper_file):
    return start_node(paper_file, invalid_output="nan", input_timeout=0.4)


def test_nan_is_repeated_while_there_is_nothing_to_answer(nan_node):
    for values in collected(nan_node.player, 1.0):
        assert 5 <= len(values) <= 15
        assert all(map(math.isnan, values))


def test_fresh_inputs_are_answered_and_turn_to_nan_when_stale(nan_node, model):
    player = nan_node.player
    assert player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    player.send_inputs(GOOD)
    player.wait_until(lambda: math.isnan(player.efficiencies[-1]), 2.0)
    assert math.isnan(player.efficiencies[-1])
    assert player.wait_until(lambda: math.isnan(player.optima[-1]), 2.0)
    assert player.hold(GOOD).efficiency == model.efficiency(*GOOD)


def test_every_refused_message_gives_nan_at_once(nan_node):
    player = nan_node.player
    player.hold(GOOD)
    player.efficiencies.clear()
    # Between two of the periodic ones, and while all is fresh otherwise.
    speed = player._inputs[1]
    speed.publish(speed.msg_type(data=math.inf))
    assert player.wait_until(lambda: any(map(math.isnan, player.efficiencies)), 2.0)
    assert player.hold(GOOD).efficiency is not None
    assert math.isfinite(player.hold(GOOD).efficiency)


def test_point_without_an_answer_gives_nan(nan_node, model):
    assert math.isnan(model.efficiency(*STALLED))
    assert math.isnan(nan_node.player.hold(STALLED).efficiency)


def test_it_can_be_changed_while_the_node_runs(nan_node):
    assert change(nan_node, "invalid_output", "silence").successful
    nan_node.player.spin_for(0.5)
    assert collected(nan_node.player, 0.5) == ([], [])
    refused = change(nan_node, "invalid_output", "zero")
    assert not refused.successful and "silence, nan" in refused.reason
    assert change(nan_node, "invalid_output", "nan").successful


def test_one_input_may_be_older_than_the_others(start_node, paper_file):
    node = start_node(paper_file, input_timeout=0.3, **{"input_timeouts.load_torque": 2.0})
    player = node.player
    assert player.hold(GOOD).efficiency is not None
    player.spin_for(0.6)

    def answered(first, second):
        player.efficiencies.clear()
        for publisher, value in ((player._inputs[first], GOOD[first]),
                                 (player._inputs[second], GOOD[second])):
            publisher.publish(publisher.msg_type(data=value))
        return player.wait_until(lambda: bool(player.efficiencies), 0.3)

    assert answered(0, 1)  # with a load torque 0.6 s old, which may be 2 s
    player.spin_for(0.6)
    assert not answered(1, 2)  # with a displacement ratio that may be 0.3 s
    assert player.wait_until(lambda: "inputs" in player.statuses, 5.0)
    values = player.statuses["inputs"]["values"]
    assert values["load_torque age limit [s]"] == "2"
    assert values["engine_speed age limit [s]"] == "0.3"
    assert change(node, "input_timeouts.displacement_ratio", 5.0).successful
    assert answered(1, 2)


def test_optimum_is_that_of_the_settings_and_the_model_now(start_node, paper_file, table2, model):
    node = start_node(paper_file, input_timeout=10.0)

    def expected(model, **options):
        return model.optimal_displacement_ratio(
            GOOD.engine_speed, GOOD.load_torque, **options).displacement_ratio

    best = expected(model)
    assert node.player.hold(GOOD).optimal_displacement_ratio == best
    for hold, limits in (("output_speed", [78.54, 230.38]), ("output_speed", [90.0, 120.0]),
                         ("engine_speed", [90.0, 120.0])):
        assert change(node, "optimum_hold", hold).successful
        assert change(node, "engine_speed_limits", limits).successful
        ratio = GOOD.displacement_ratio if hold == "output_speed" else None
        assert node.player.hold(GOOD).optimal_displacement_ratio == expected(
            model, hold=hold, displacement_ratio=ratio, engine_speed_limits=tuple(limits))

    # With the output speed held, another displacement ratio is another question.
    assert change(node, "optimum_hold", "output_speed").successful
    node.player.hold(GOOD)
    other = GOOD._replace(displacement_ratio=0.3)
    assert node.player.hold(other).optimal_displacement_ratio == expected(
        model, hold="output_speed", displacement_ratio=0.3, engine_speed_limits=(90.0, 120.0))

    # Another model is, too, although the inputs stay.
    assert change(node, "optimum_hold", "engine_speed").successful
    send_table(node.player, table2)
    assert node.player.hold(GOOD).optimal_displacement_ratio == best
    file = node.player.call("reidentify").data["file"]
    refitted = expected(hmcvt.load_model(file))
    assert refitted != best
    assert node.player.hold(GOOD).optimal_displacement_ratio == refitted


def test_the_node_describes_every_parameter(nan_node):
    client = AsyncParameterClient(nan_node.player, f"{nan_node.namespace}/hmcvt")
    assert client.wait_for_services(10.0)
    future = client.describe_parameters([declaration.name for declaration in PARAMETERS])
    assert nan_node.player.wait_until(future.done, 10.0)
    for found, declaration in zip(future.result().descriptors, PARAMETERS, strict=True):
        assert found.name == declaration.name
        assert declaration.description in found.description
        assert declaration.unit in found.description
        assert found.additional_constraints == declaration.allowed
        assert found.read_only == declaration.read_only
        ranges = [*found.floating_point_range, *found.integer_range]
        if declaration.limits and not isinstance(declaration.default, list):
            assert [(item.from_value, item.to_value) for item in ranges] == [declaration.limits]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node answers its inputs with what the model says, and with nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, STALLED, points, send_table

import hmcvt_core as hmcvt
from hmcvt_ros import messages


@pytest.fixture(scope="module")
def model(paper_file):
    return hmcvt.load_model(paper_file)


def best(model, point=GOOD, **options):
    return model.optimal_displacement_ratio(
        point.engine_speed, point.load_torque, **options).displacement_ratio


def test_every_bench_test_gets_exactly_the_answer_of_the_model(node, model, table2):
    for point in points(table2):
        assert node.player.hold(point) == (model.efficiency(*point), best(model, point))


def test_each_arrival_is_answered_once(node):
    player = node.player
    player.hold(GOOD)
    player.efficiencies.clear()
    player.optima.clear()
    for _ in range(20):
        player.send_inputs(GOOD)
        player.spin_for(0.02)
    node.comes(lambda: len(player.optima) >= 60, 2.0)
    assert len(player.efficiencies) == len(player.optima) == 60


def test_diagnostics_are_good_while_inputs_flow(node, model):
    def good():
        node.player.send_inputs(GOOD)
        return node.status("inputs")["level"] == DiagnosticStatus.OK

    assert node.comes(good), node.player.statuses
    inputs, served = node.status("inputs"), node.status()
    assert inputs["message"] == "three fresh inputs"
    assert float(inputs["values"]["engine_speed age [s]"]) < 0.5
    assert served["values"]["fingerprint"] == model.fingerprint


def test_late_joiner_gets_model_and_map(node, model, tmp_path):
    late = node.connect(node.namespace)
    assert late.wait_until(lambda: late.model_text is not None and late.map is not None, 10.0)
    copy = tmp_path / "copy.yaml"
    copy.write_text(late.model_text)
    assert hmcvt.load_model(copy).fingerprint == model.fingerprint
    served = yaml.safe_load(late.model_text)["served"]
    assert served["fingerprint"] == model.fingerprint
    assert served["since"].endswith("Z")

    expected = messages.map_to_message(model.efficiency_map(
        np.linspace(-1.0, 1.0, 41), np.linspace(78.54, 230.38, 17), np.linspace(50.0, 400.0, 15)))
    assert late.map.layout == expected.layout
    np.testing.assert_allclose(late.map.data, expected.data, rtol=1e-12)
    assert np.isfinite(late.map.data[late.map.layout.data_offset:]).any()


def test_point_without_an_answer_is_silence_and_a_warning(node, model):
    assert np.isnan(model.efficiency(*STALLED))
    node.player.hold(GOOD)
    assert node.player.hold(STALLED, patience=0.0).efficiency is None

    def warned():
        node.player.send_inputs(STALLED)
        return "the load cannot be carried" in node.status()["message"]

    assert node.comes(warned), node.player.statuses


def test_rate_limit_answers_the_last_of_a_burst(node, model):
    player = node.player
    node.set(max_output_rate=20.0)
    player.hold(GOOD)
    player.efficiencies.clear()
    for _ in range(100):
        player.send_inputs(GOOD)
        player.spin_for(0.01)
    last = GOOD._replace(load_torque=210.0)
    player.send_inputs(last)
    assert node.comes(lambda: player.efficiencies[-1] == model.efficiency(*last), 2.0)
    assert 10 <= len(player.efficiencies) <= 40


# --- NaN instead of silence -----------------------------------------------------------------------


@pytest.fixture
def nan_node(node):
    assert all(result.successful for result in node.set(invalid_output="nan", input_timeout=0.3))
    return node


def test_nan_is_repeated_while_there_is_nothing_to_answer(nan_node):
    player = nan_node.player
    nan_node.comes(lambda: player.optima and math.isnan(player.optima[-1]), 2.0)
    player.efficiencies.clear()
    player.optima.clear()
    player.spin_for(1.0)
    for values in (player.efficiencies, player.optima):
        assert 5 <= len(values) <= 15
        assert all(map(math.isnan, values))
    assert nan_node.set(invalid_output="silence")[0].successful
    player.efficiencies.clear()
    player.spin_for(0.3)
    assert player.efficiencies == []


def test_fresh_inputs_are_answered_and_turn_to_nan_when_stale(nan_node, model):
    player = nan_node.player
    assert player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    assert nan_node.comes(lambda: math.isnan(player.efficiencies[-1]), 2.0)
    assert nan_node.comes(lambda: math.isnan(player.optima[-1]), 2.0)
    assert player.hold(GOOD).efficiency == model.efficiency(*GOOD)
    assert math.isnan(player.hold(STALLED).efficiency)  # a point without an answer


def test_every_refused_message_gives_nan_at_once(nan_node):
    player = nan_node.player
    nan_node.set(input_timeout=20.0)  # none of the periodic ones
    player.hold(GOOD)
    player.efficiencies.clear()
    player._inputs[1].publish(player._inputs[1].msg_type(data=math.inf))
    assert nan_node.comes(lambda: any(map(math.isnan, player.efficiencies)), 2.0)
    assert math.isfinite(player.hold(GOOD).efficiency)


# --- settings -------------------------------------------------------------------------------------


def test_one_input_may_be_older_than_the_others(node):
    player = node.player
    node.set(input_timeout=0.3, input_timeouts__load_torque=10.0)
    assert player.hold(GOOD).efficiency is not None
    player.spin_for(0.4)

    def answered(*which):
        player.efficiencies.clear()
        for i in which:
            player._inputs[i].publish(player._inputs[i].msg_type(data=GOOD[i]))
        return node.comes(lambda: player.efficiencies, 0.25)

    assert answered(0, 1)  # with a load torque that may be 10 s old
    player.spin_for(0.4)
    assert not answered(1, 2)  # with a displacement ratio that may be 0.3 s
    assert node.comes(lambda: node.value("load_torque age limit [s]", "inputs") == "10")
    assert node.value("engine_speed age limit [s]", "inputs") == "0.3"
    assert node.set(input_timeouts__displacement_ratio=10.0)[0].successful
    assert answered(1, 2)


def test_optimum_is_that_of_the_settings_and_the_model_now(node, table2, model):
    player = node.player
    node.set(input_timeout=10.0)
    assert player.hold(GOOD).optimal_displacement_ratio == best(model)
    for hold, limits in (("output_speed", [78.54, 230.38]), ("output_speed", [90.0, 120.0]),
                         ("engine_speed", [90.0, 120.0])):
        node.set(optimum_hold=hold, engine_speed_limits=limits)
        ratio = GOOD.displacement_ratio if hold == "output_speed" else None
        assert player.hold(GOOD).optimal_displacement_ratio == best(
            model, hold=hold, displacement_ratio=ratio, engine_speed_limits=tuple(limits))

    # With the output speed held, another displacement ratio is another question.
    node.set(optimum_hold="output_speed")
    player.hold(GOOD)
    other = GOOD._replace(displacement_ratio=0.3)
    assert player.hold(other).optimal_displacement_ratio == best(
        model, hold="output_speed", displacement_ratio=0.3, engine_speed_limits=(90.0, 120.0))

    # Another model is, too, although the inputs stay.
    node.set(optimum_hold="engine_speed")
    send_table(node, table2)
    before = player.hold(GOOD).optimal_displacement_ratio
    assert before == best(model)
    reply = player.call("reidentify")
    assert reply.success, reply.data
    refitted = best(hmcvt.load_model(node.state / reply.data["file"]))
    assert player.hold(GOOD).optimal_displacement_ratio == refitted != before


def test_parameter_changes_are_checked(node):
    for name, value, word in [
        ("input_timeout", 0.0, "0.01"),
        ("input_timeout", math.nan, ""),
        ("engine_speed_limits", [230.0, 80.0], "rising"),
        ("model_file", "/etc/passwd", "read-only"),
    ]:
        result, = node.set(**{name: value})
        assert not result.successful, (name, value)
        assert word in result.reason
    assert node.set(engine_speed_limits=[80.0, 200.0])[0].successful
    assert node.comes(lambda: node.player.map.data[41] == 80.0)

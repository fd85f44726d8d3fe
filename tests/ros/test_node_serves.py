# SPDX-License-Identifier: Apache-2.0
"""The node answers its inputs with what the model says, and with nothing else."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, points

import hmcvt_core as hmcvt


@pytest.fixture(scope="module")
def node(start_node, paper_file):
    return start_node(paper_file)


@pytest.fixture(scope="module")
def model(paper_file):
    return hmcvt.load_model(paper_file)


@pytest.mark.parametrize("test", range(8))
def test_every_bench_test_gets_exactly_the_answer_of_the_model(node, model, table2, test):
    point = points(table2)[test]
    answer = node.player.hold(point)
    assert answer.efficiency == model.efficiency(*point)
    best = model.optimal_displacement_ratio(point.engine_speed, point.load_torque)
    assert answer.optimal_displacement_ratio == best.displacement_ratio


def test_each_arrival_is_answered_once(node):
    node.player.hold(GOOD)
    node.player.efficiencies.clear()
    node.player.optima.clear()
    for _ in range(20):
        node.player.send_inputs(GOOD)
        node.player.spin_for(0.05)
    node.player.wait_until(lambda: len(node.player.optima) >= 60, 2.0)
    assert len(node.player.efficiencies) == len(node.player.optima) == 60


def test_diagnostics_are_good_while_inputs_flow(node, model):
    def good():
        node.player.send_inputs(GOOD)
        status = node.player.statuses.get("inputs")
        return status is not None and status["level"] == DiagnosticStatus.OK

    assert node.player.wait_until(good, 5.0), node.player.statuses
    inputs, served = node.player.statuses["inputs"], node.player.statuses["model"]
    assert inputs["message"] == "three fresh inputs"
    assert float(inputs["values"]["engine_speed age [s]"]) < 0.5
    assert served["level"] == DiagnosticStatus.OK
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

    grid = late.map
    assert grid.efficiency.shape == (41, 17, 15)
    assert (grid.displacement_ratio[0], grid.displacement_ratio[-1]) == (-1.0, 1.0)
    expected = model.efficiency(*np.meshgrid(
        grid.displacement_ratio, grid.engine_speed, grid.load_torque, indexing="ij"))
    np.testing.assert_allclose(grid.efficiency, expected, rtol=1e-12)
    assert np.isfinite(grid.efficiency).any()


def test_point_without_an_answer_is_silence_and_a_warning(node, model):
    stalled = GOOD._replace(displacement_ratio=-1.0, engine_speed=20.0, load_torque=5000.0)
    assert np.isnan(model.efficiency(*stalled))
    node.player.hold(GOOD)
    assert node.player.hold(stalled).efficiency is None

    def warned():
        node.player.send_inputs(stalled)
        return "the load cannot be carried" in node.player.statuses["model"]["message"]

    assert node.player.wait_until(warned, 5.0), node.player.statuses


def test_held_output_speed_and_rate_limit(start_node, paper_file, model):
    node = start_node(paper_file, optimum_hold="output_speed", max_output_rate=20.0)
    best = model.optimal_displacement_ratio(
        GOOD.engine_speed, GOOD.load_torque, hold="output_speed",
        displacement_ratio=GOOD.displacement_ratio, engine_speed_limits=(78.54, 230.38))
    assert node.player.hold(GOOD).optimal_displacement_ratio == best.displacement_ratio
    node.player.efficiencies.clear()
    for _ in range(100):
        node.player.send_inputs(GOOD)
        node.player.spin_for(0.01)
    # The last of a burst is answered although the limit held it back.
    last = GOOD._replace(load_torque=210.0)
    node.player.send_inputs(last)
    assert node.player.wait_until(
        lambda: node.player.efficiencies[-1] == model.efficiency(*last), 2.0)
    assert 10 <= len(node.player.efficiencies) <= 40

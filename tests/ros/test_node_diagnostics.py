# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnostics: levels, the input that lies outside the data; of counts: test_fuzz.py."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD

import hmcvt_core as hmcvt


@pytest.fixture(scope="module")
def node(refused):
    """A node of the shipped model, which knows the data that it was identified from."""
    return refused[0]


@pytest.mark.parametrize(("changes", "complaints"), [
    ({}, []),
    ({"engine_speed": 200.0},
     ["engine_speed 200 rad/s is not in 78.54 to 146.6 rad/s (750 to 1400 r/min)"]),
    ({"engine_speed": 160.0, "load_torque": 350.0},
     ["engine_speed 160", "load_torque 350 N m is not in 101.9 to 292.9 N m"]),
])
def test_extrapolation_names_the_input_and_its_range(node, changes, complaints):
    point = GOOD._replace(**changes)

    def told():
        node.player.send_inputs(point)
        text = node.value("extrapolation")
        return all(word in text for word in complaints) and (text == "no") == (not complaints)

    assert node.comes(told), node.player.statuses
    status = node.status()
    assert status["level"] == (DiagnosticStatus.WARN if complaints else DiagnosticStatus.OK)
    assert all(complaint in status["message"] for complaint in complaints)
    assert ("extrapolation" in status["message"]) == bool(complaints)


def test_status_of_the_model_says_which_and_how_good(node):
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    assert node.comes(lambda: node.value("fingerprint") == model.fingerprint)
    assert node.value("file").endswith("hm4.yaml")
    assert float(node.value("fit error [-]")) == model.provenance["fit_error"]
    assert (node.value("last diagnosis"), node.value("running")) == ("none", "-")

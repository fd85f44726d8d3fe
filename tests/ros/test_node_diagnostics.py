# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnostics: levels, counts that add up, the input that lies outside the data."""

from __future__ import annotations

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD

import hmcvt_core as hmcvt


@pytest.fixture(scope="module")
def node(refused):
    """A node of the shipped model, which knows the data that it was identified from."""
    return refused[0]


def test_inputs_received_are_those_accepted_and_those_refused(node):
    def counts(name):
        values = node.player.statuses.get("inputs", {"values": {}})["values"]
        return [int(values.get(f"{name} {word}", 0)) for word in (
            "received", "accepted", "refused, not finite", "refused, out of range")]

    node.forget_status()
    assert node.comes(lambda: "inputs" in node.player.statuses)
    before = {name: counts(name) for name in GOOD._fields}
    for name, publisher in zip(GOOD._fields, node.player._inputs, strict=True):
        good = getattr(GOOD, name)
        for value in [good, math.nan, good, 9e9, good, -math.inf, good, math.nan]:
            publisher.publish(publisher.msg_type(data=value))
            node.player.spin_for(0.02)  # best effort: a burst may lose some
    for name, old in before.items():
        assert node.comes(lambda name=name, old=old: counts(name) == [
            one + more for one, more in zip(old, [8, 4, 3, 1], strict=True)]), counts(name)


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

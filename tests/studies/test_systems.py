# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The trial of other machines: what it hides, and what it counts as right."""

import importlib.util

import pytest

from studies import systems


@pytest.mark.parametrize("name", ["fan", "drive"])
def test_a_listed_cause_is_hidden_and_named(name):
    record = systems.trial(name, systems.LISTED, seed=100)
    assert record["leading"] == [record["hidden"]]
    assert record["right"]


@pytest.mark.parametrize("name", ["fan", "drive"])
def test_an_unlisted_loss_is_refused(name):
    record = systems.trial(name, systems.UNLISTED, seed=100)
    assert record["hidden"] in systems.MACHINES[name].unlisted
    assert record["right"]


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None,
    reason="needs MuJoCo (pip install mujoco)",
)
def test_friction_of_a_joint_in_mujoco_is_named():
    record = systems.trial("joint", systems.LISTED, seed=100)
    assert record["hidden"] == "coulomb_friction"
    assert record["right"]


def test_page_lists_wrong_answers():
    right = systems.trial("fan", systems.LISTED, seed=100)
    wrong = {**right, "right": False, "leading": ["belt_slip"], "seed": 7}
    page = systems.written([right, wrong], campaigns=1, first_seed=100)
    assert "| fan, listed cause named | >= 80 % | 1 of 2 | **missed** |" in page
    assert (
        "| fan | 7 | bearing drag (listed) | cause found | belt slip (100 %) |" in page
    )

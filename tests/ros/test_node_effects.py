# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A node serves a model with an effect of one's own, and its worker knows it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from ros_bench import GOOD as ANYWHERE
from ros_bench import send_table

import hmcvt_core as hmcvt

GOOD = ANYWHERE._replace(load_torque=390.0)  # where the valve is open
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "own_effect.py"


def test_an_effect_of_ones_own_is_served_and_refitted(start_node, tmp_path, table2):
    path = tmp_path / "valve.yaml"
    data = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")).to_mapping()
    data["effects"] = [{"effect": "relief_valve", "parameters": {
        "leak": {"value": 6e-11, "unit": "m3/(s Pa)"},
        "cracking": {"value": 6.0, "unit": "MPa"}}}]
    path.write_text(yaml.safe_dump(data))
    node = start_node(path, effects_file=EXAMPLE)
    answer = node.player.hold(GOOD).efficiency
    told = subprocess.run(  # in a process of its own: a class stays in the library for good
        [sys.executable, "-m", "hmcvt_core.cli", "predict", "--params", path, "--effects", EXAMPLE,
         "--json", *(word for name, value in GOOD._asdict().items()
                     for word in (f"--{name.replace('_', '-')}", str(value)))],
        capture_output=True, text=True, check=True, cwd=EXAMPLE.parents[1])
    assert answer == pytest.approx(json.loads(told.stdout)["efficiency"], rel=1e-9)
    assert answer < hmcvt.load_model(hmcvt.data_path("params/hm4.yaml")).efficiency(*GOOD) - 0.001

    send_table(node, table2)
    _, found = node.player.call("reidentify")  # in the worker, which has to know it too
    assert found["samples"] == 8, found

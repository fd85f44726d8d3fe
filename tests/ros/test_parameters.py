# SPDX-License-Identifier: Apache-2.0
"""The table of parameters and the YAML that repeats it for the user."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml

import hmcvt_core as hmcvt
import hmcvt_ros
from hmcvt_ros.parameters import PARAMETERS, Settings, usage

FOLDER = Path(hmcvt_ros.__file__).parent
DEFAULTS = {declaration.name: declaration.default for declaration in PARAMETERS}


def settings(**changes):
    return Settings.of({**DEFAULTS, **changes})


def test_yaml_holds_every_parameter_with_its_default_and_a_comment():
    path = FOLDER / "config" / "hmcvt.yaml"
    data = yaml.safe_load(path.read_text())
    given = data["/**"]["ros__parameters"]
    assert given == DEFAULTS
    assert all(type(given[name]) is type(value) for name, value in DEFAULTS.items())
    lines = path.read_text().splitlines()
    for number, line in enumerate(lines):
        if line.strip().partition(":")[0] in DEFAULTS:
            assert lines[number - 1].strip().startswith("#"), line


def test_defaults_are_valid_and_help_names_all():
    assert settings().input_timeout == 0.5
    text = usage()
    assert all(f"  {name}" in text for name in DEFAULTS)
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize(("name", "value", "word"), [
    ("input_timeout", float("nan"), "0.01 to 60 s"),
    ("max_output_rate", -1.0, "0 to 1000 Hz"),
    ("engine_speed_limits", (100.0,), "two rising numbers"),
    ("engine_speed_limits", (100.0, 100.0), "two rising numbers"),
    ("map_load_torque_limits", (0.0, 100.0), "1 to 5000 N m"),
    ("map_points", (10, 10), "three counts"),
    ("map_points", (100, 100, 100), "100000"),
    ("map_points", (1, 10, 10), "2 to 500"),
    ("reidentify_min_samples", 0, "1 to 100000"),
])
def test_bad_value_names_parameter_and_range(name, value, word):
    with pytest.raises(hmcvt.InputError, match=name) as caught:
        settings(**{name: value})
    assert word in str(caught.value)


def test_commands_of_the_node_can_be_loaded():
    names = {entry.name for entry in entry_points(group="console_scripts")
             if entry.value.startswith("hmcvt_ros") and callable(entry.load())}
    assert names == {"hmcvt-node", "efficiency_node"}

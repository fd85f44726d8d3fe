# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The table of parameters and the YAML that repeats it for the user."""

from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml

import hmcvt_core as hmcvt
import hmcvt_ros
from hmcvt_ros import parameters
from hmcvt_ros.parameters import PARAMETERS, Settings

FILE = Path(hmcvt_ros.__file__).parent / "config" / "hmcvt.yaml"
DEFAULTS = {declaration.name: declaration.default for declaration in PARAMETERS}


def settings(**changes):
    return Settings.of({**DEFAULTS, **changes})


def flat(data, prefix=""):
    """Names with a dot for each level, as ROS makes them of a YAML file."""
    for name, value in data.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield prefix + name, value


def test_yaml_holds_every_parameter_with_its_default():
    given = dict(flat(yaml.safe_load(FILE.read_text())["/**"]["ros__parameters"]))
    assert given == DEFAULTS
    assert all(type(given[name]) is type(value) for name, value in DEFAULTS.items())


@pytest.mark.parametrize(
    "declaration", PARAMETERS, ids=lambda declaration: declaration.name
)
def test_every_number_has_limits_and_every_descriptor_tells_all(declaration):
    descriptor = declaration.descriptor()
    assert len(declaration.description) > 20
    assert declaration.description in descriptor.description
    assert declaration.unit in descriptor.description
    assert descriptor.read_only == (declaration.read_only or declaration.protects)
    assert declaration.descriptor(True).read_only == declaration.read_only
    if isinstance(declaration.default, bool):
        return
    if isinstance(declaration.default, str):
        assert declaration.default == "" or declaration.default in declaration.choices
    else:
        assert declaration.limits is not None
    assert descriptor.additional_constraints == declaration.allowed
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    assert [(item.from_value, item.to_value) for item in ranges] == (
        [declaration.limits]
        if declaration.limits and not isinstance(declaration.default, list)
        else []
    )


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("input_timeout", float("nan"), "0.01 to 60 s"),
        ("input_timeouts.engine_speed", -1.0, "0 to 60 s"),
        ("input_timeouts.engine_speed", 0.005, "at least 0.01 s"),
        ("invalid_output", "zero", "silence, nan"),
        ("optimum_hold", "ground", "engine_speed, output_speed"),
        ("max_output_rate", -1.0, "0 to 1000 Hz"),
        ("max_output_rate", 1e-9, "at least 1 Hz"),
        ("engine_speed_limits", (100.0,), "two rising numbers"),
        ("engine_speed_limits", (100.0, 100.0), "two rising numbers"),
        ("map_load_torque_limits", (0.0, 100.0), "1 to 5000 N m"),
        ("map_points", (10, 10), "three counts"),
        ("map_points", (100, 100, 100), "100000"),
        ("map_points", (1, 10, 10), "2 to 500"),
        ("reidentify_min_samples", 0, "1 to 100000"),
    ],
)
def test_bad_value_names_parameter_and_range(name, value, word):
    with pytest.raises(hmcvt.InputError, match=name) as caught:
        settings(**{name: value})
    assert word in str(caught.value)


def test_every_command_can_be_loaded():
    names = {
        entry.name
        for entry in entry_points(group="console_scripts")
        if entry.value.startswith("hmcvt_") and callable(entry.load())
    }
    assert names == {"hmcvt", "hmcvt-node", "efficiency_node"}


@pytest.mark.parametrize(
    ("section", "node", "applies"),
    [
        ("/**", "/hmcvt", True),
        ("hmcvt", "/hmcvt", True),
        ("hmcvt", "/tractor1/hmcvt", False),
        ("/tractor1/hmcvt", "/tractor1/hmcvt", True),
        ("/**/hmcvt", "/hmcvt", True),
        ("/*/hmcvt", "/hmcvt", False),
        ("/*", "/hmcvt", True),
        ("efficiency_node", "/hmcvt", False),
        ("tractor1:\n  hmcvt", "/tractor1/hmcvt", True),
    ],
)
def test_section_of_a_parameter_file(section, node, applies, tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(
        f"{section}:\n    ros__parameters: {{optimum_hold: engine_speed}}\n"
    )
    assert parameters.applies_to(path, node) == applies


def test_empty_parameter_file_applies_to_nothing(tmp_path):
    (tmp_path / "p.yaml").touch()
    assert not parameters.applies_to(tmp_path / "p.yaml", "/hmcvt")

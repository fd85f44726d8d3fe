# SPDX-License-Identifier: Apache-2.0
"""One name and one version in every file that has to repeat them, and the files that ship."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from importlib.metadata import entry_points, version
from pathlib import Path

import pytest

import hmcvt_core as hmcvt

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()


def test_package_xml_repeats_name_and_version():
    assert PACKAGE.findtext("name") == "hmcvt_ros"
    assert PACKAGE.findtext("version") == hmcvt.__version__ == version("hmcvt_ros")
    # ROS finds an ament_python package by an empty marker of its name.
    assert (ROOT / "hmcvt_ros" / "resource" / PACKAGE.findtext("name")).read_bytes() == b""


def test_every_command_can_be_loaded():
    commands = {entry.name: entry for entry in entry_points(group="console_scripts")
                if entry.value.startswith("hmcvt_")}
    assert set(commands) == {"hmcvt", "hmcvt-node", "efficiency_node"}
    for entry in commands.values():
        if entry.name == "hmcvt":  # the others need ROS: tests/ros
            assert callable(entry.load())


@pytest.mark.parametrize("folder", ["data", "params"])
def test_every_shipped_file_is_found(folder):
    files = [path for path in (ROOT / folder).iterdir() if path.is_file()]
    assert files
    for path in files:
        found = hmcvt.data_path(f"{folder}/{path.name}")
        assert found.read_bytes() == path.read_bytes()


def test_file_that_does_not_ship_is_told():
    with pytest.raises(hmcvt.InputError, match=r"params/hm5\.yaml does not ship"):
        hmcvt.data_path("params/hm5.yaml")

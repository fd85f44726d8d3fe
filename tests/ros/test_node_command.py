# SPDX-License-Identifier: Apache-2.0
"""`hmcvt node` is the node: the same messages, exit codes and signals as `hmcvt-node`."""

from __future__ import annotations

import signal
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest

import hmcvt_core as hmcvt

ROOT = Path(hmcvt.__file__).parents[1]
INSTALLED = bool(tuple(entry_points(group="console_scripts", name="hmcvt-node")))
COMMAND = [sys.executable, "-m", "hmcvt_core.cli", "node"]
# What an installation leaves in site-packages; here also for a checkout that is not installed.
ENTRY_POINTS = "[console_scripts]\nhmcvt-node = hmcvt_ros.efficiency_node:main\n"


@pytest.fixture(scope="session")
def place(environment, tmp_path_factory):
    """Environment in which the node is found under its name."""
    folder = tmp_path_factory.mktemp("installed")
    if not INSTALLED:
        info = folder / "hmcvt_ros-0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: hmcvt_ros\nVersion: 0\n")
        (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return {**environment, "PYTHONPATH": f"{ROOT}:{folder}"}


def run(environment, *arguments, command=COMMAND):
    return subprocess.run([*command, *arguments], env=environment, capture_output=True, text=True,
                          timeout=30)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serves_until_it_is_stopped(place, connect, tmp_path, number):
    namespace = f"/command{int(number)}"
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(
            [*COMMAND, "--ros-args", "-p", f"state_folder:={tmp_path / 'state'}",
             "-r", f"__ns:={namespace}"], env=place, stdout=log, stderr=log)
    try:
        player = connect(namespace)
        up = player.wait_for_node(running=lambda: process.poll() is None)
        assert up, (tmp_path / "log").read_text()
        assert "schema: hmcvt-model" in player.model_text
        process.send_signal(number)
        assert process.wait(timeout=10) == 0
    finally:
        process.kill()
        process.wait()
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_help_is_of_the_command_and_of_the_node(place):
    own, node = run(place, "--help"), run(place, "--", "--help")
    assert own.returncode == node.returncode == 0
    assert "hmcvt node --ros-args" in own.stdout
    assert node.stdout.startswith("usage: hmcvt-node") and "input_timeout" in node.stdout


def test_arguments_arrive_as_they_are(place, tmp_path):
    # `--` ends the arguments of ROS; what follows is the node's, which knows none but --help.
    done = run(place, "--ros-args", "-p", f"state_folder:={tmp_path}", "--", "--wrong")
    assert done.returncode == 2
    assert done.stderr == "hmcvt: error: unknown argument --wrong; see --help\n"
    done = run(place, "--ros-args", "-p", "input_timeout:=100.0")
    assert done.returncode == 2 and "0.01 to 60 s" in done.stderr


def test_without_ros_it_says_what_to_install(place, tmp_path):
    # A Python that has the command, but neither the site-packages with ROS nor the node.
    code = ("import sys; sys.modules['rclpy'] = None\n"
            "from hmcvt_core.cli import main; main(['node'])")
    done = subprocess.run([sys.executable, "-c", code], env=place, capture_output=True, text=True,
                          timeout=30)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("hmcvt: error: the node needs ROS 2 (")
    assert "pip install '.[ros]'" in done.stderr and done.stderr.count("\n") == 1


def test_not_installed_is_told(place):
    code = ("import importlib.metadata as m\n"
            "m.entry_points = lambda **_: ()\n"
            "from hmcvt_core.cli import main; main(['node'])")
    done = subprocess.run([sys.executable, "-c", code], env=place, capture_output=True, text=True,
                          timeout=30)
    assert done.returncode == 2
    assert done.stderr == ("hmcvt: error: hmcvt-node is not installed here; in the folder of "
                           "hmcvt: pip install '.[ros]'\n")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""How the process starts and ends, as `hmcvt-node` and as `hmcvt node`, and what it has loaded."""

import dataclasses
import json
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, command, message

import hmcvt_core as hmcvt
from hmcvt_core.physics.effects.mechanical import PlanetaryMesh

pytestmark = pytest.mark.slow

ROOT = Path(hmcvt.__file__).parents[1]
HMCVT_NODE = [sys.executable, "-m", "hmcvt_tools.cli", "node"]


@pytest.fixture(scope="module")
def place(environment):
    return {**environment, "PYTHONPATH": str(ROOT)}


def run(environment, *arguments):
    """Run a command; one that hangs says where, by the traceback that SIGABRT prints."""
    limited = ("timeout", "--signal=ABRT", "--kill-after=5", "60", *arguments)
    told = {**environment, "PYTHONFAULTHANDLER": "1"}
    done = subprocess.run(limited, env=told, capture_output=True, text=True)
    hung = done.returncode in (124, 137)  # by SIGABRT, or by SIGKILL after it
    assert not hung, (arguments, done.stderr)
    return done


def all_at_once(environment, commands):
    """Run commands side by side: most of their time goes into starting Python."""
    with ThreadPoolExecutor(4) as pool:
        return list(pool.map(lambda words: run(environment, *words), commands))


def test_wrong_parameter_is_one_line_and_exit_code_2(place, tmp_path, paper_file):
    cut = tmp_path / "cut.yaml"
    cut.write_text(paper_file.read_text()[:500])
    cases = [  # other files: test_model_store.py and tests/core/test_parameter_file.py
        (f"model_file:={cut}", [f"{cut}: "]),
        ("model_file:=/nowhere/x.yaml", ["/nowhere/x.yaml", "No such file"]),
        ("input_timeout:=1", ["input_timeout", "write 1.0"]),
        (
            "input_timeout:=.nan",
            ["input_timeout", "0.01 to 60 s"],
        ),  # others: test_parameters.py
    ]
    found = all_at_once(
        place,
        [
            command(
                f"model_file:={paper_file}",
                f"state_folder:={tmp_path / str(i)}",
                parameter,
            )
            for i, (parameter, _) in enumerate(cases)
        ],
    )
    for (parameter, words), result in zip(cases, found, strict=True):
        assert result.returncode == 2, (parameter, result.stderr)
        assert result.stderr.count("\n") == 1 and result.stderr.startswith(
            "hmcvt: error: "
        )
        assert all(word in result.stderr for word in words), result.stderr


def test_wrong_argument_is_told_and_help_is_printed(place, tmp_path):
    state = f"state_folder:={tmp_path}"
    parsed, unknown, passed_on, own, node, other = all_at_once(
        place,
        [
            command(arguments=("--params-file", "/nowhere.yaml")),
            command(arguments=("-z",)),
            # `--` ends the arguments of ROS; the node itself takes --help alone.
            [*HMCVT_NODE, "--ros-args", "-p", state, "--", "--wrong"],
            [*HMCVT_NODE, "--help"],
            [*HMCVT_NODE, "--", "--help"],
            command(arguments=("--", "--help")),
        ],
    )
    for result, words in (
        (parsed, "Couldn't parse params file"),
        (unknown, "-z"),
        (passed_on, "unknown argument --wrong; see --help"),
    ):
        assert result.returncode == 2 and "Traceback" not in result.stderr
        last = result.stderr.splitlines()[-1]
        assert last.startswith("hmcvt: error: ") and words in last
    assert own.returncode == node.returncode == other.returncode == 0
    assert "hmcvt node --ros-args" in own.stdout
    assert node.stdout == other.stdout and other.stderr == ""
    assert (
        node.stdout.startswith("usage: hmcvt-node")
        and "input_timeout [s]" in node.stdout
    )


@pytest.mark.parametrize(
    "start",
    [
        "from hmcvt_tools.cli import main; main(['node'])",
        "from hmcvt_ros.efficiency_node import main; sys.exit(main(['hmcvt-node']))",
    ],
)
def test_without_ros_it_says_what_to_install(place, start):
    code = f"import sys; sys.modules['rclpy'] = None\n{start}"
    done = run(place, sys.executable, "-c", code)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("hmcvt: error: the node needs ROS 2 (")
    assert 'pip install ".[ros]"' in done.stderr and done.stderr.count("\n") == 1


def test_hmcvt_node_serves_until_it_is_stopped(place, connect, tmp_path):
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(
            [
                *HMCVT_NODE,
                "--ros-args",
                "-p",
                f"state_folder:={tmp_path / 'state'}",
                "-r",
                "__ns:=/command",
            ],
            env=place,
            stdout=log,
            stderr=log,
        )
    try:
        player = connect("/command")
        up = player.wait_for_node(running=lambda: process.poll() is None)
        assert up, (tmp_path / "log").read_text()
        # The model that comes with hmcvt is the default, and the log says so.
        shipped = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
        assert shipped.fingerprint in player.model_text
        for _ in range(20):
            player.send_inputs(GOOD)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 0
    finally:
        process.kill()
        process.wait()
    said = (tmp_path / "log").read_text()
    assert (
        "Traceback" not in said and "the model that comes with hmcvt is served" in said
    )


def test_unusable_state_folder_and_unknown_parameter_do_not_stop_it(
    start_node, paper_file, table2, tmp_path
):
    # Nor does a model with an effect in it, as the diagnosis writes them.
    plain = hmcvt.load_model(paper_file)
    model = dataclasses.replace(plain, effects=(PlanetaryMesh(0.08),))
    hmcvt.save_model(model, tmp_path / "diagnosed.yaml")
    (tmp_path / "file").write_text("")
    node = start_node(
        tmp_path / "diagnosed.yaml", state=tmp_path / "file" / "state", inputtimeout=1.0
    )
    assert node.says("parameter inputtimeout is unknown and has no effect")
    assert node.says("state_folder")
    assert (
        plain.efficiency(*GOOD)
        != model.efficiency(*GOOD)
        == node.player.hold(GOOD).efficiency
    )
    assert not node.player.call("reidentify").success
    node.player.send_sample(message(table2, 0))
    assert node.comes(lambda: node.value("bench samples refused, not written") == "1")
    assert node.status()["level"] == DiagnosticStatus.ERROR


START = """
import json, sys
import rclpy
from hmcvt_ros.node import EfficiencyNode
rclpy.init(args=["--ros-args", "-p", "state_folder:=" + sys.argv[1]])
node = EfficiencyNode()
with open(sys.argv[2], "w") as file:
    json.dump(sorted(sys.modules), file)
node.close()
node.destroy_node()
rclpy.shutdown()
"""


def test_node_loads_nothing_that_only_refits_plots_or_commands_need(place, tmp_path):
    # Not by standard output: Fast DDS reports failures of its shared memory there.
    listed = tmp_path / "modules.json"
    run(place, sys.executable, "-c", START, str(tmp_path), str(listed))
    loaded = set(json.loads(listed.read_text()))
    assert "hmcvt_core.physics.steady_state" in loaded
    assert not loaded & {
        "scipy.optimize",
        "scipy.stats",
        "scipy.interpolate",
        "matplotlib",
        "pymoo",
        "distributed",
        "rosbags",
        "click",
    }


def test_worker_is_given_nothing_of_ros(place):
    """It is given the main module of the node, and at full priority."""
    code = (
        "import hmcvt_ros.efficiency_node, hmcvt_ros.worker, sys\nprint(*sys.modules)"
    )
    loaded = set(run(place, sys.executable, "-c", code).stdout.split())
    assert (
        "hmcvt_ros.worker" in loaded and not {"rclpy", "numpy", "hmcvt_core"} & loaded
    )

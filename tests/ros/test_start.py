# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Ordinary mistakes at the start: one line and exit code 2, or a warning that stays."""

import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_bench import GOOD, Shim, command, send_table
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32, Float64, Int32

import hmcvt_core as hmcvt
from hmcvt_ros.public_text import PublicText

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
IN = ("sh", "-c", 'cd "$0" && exec "$@"')
IN_NO_FOLDER = ("sh", "-c", 'mkdir -p "$0" && cd "$0" && rmdir "$0" && exec "$@"')
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}

REFUSED = {
    "advice asks": (
        ["-r", "advice:=operating_point"],
        {},
        "operating_point is the name of 2 topics",
    ),
    "two services in one": (
        ["-r", "~/reidentify:=job", "-r", "~/cancel:=job"],
        {},
        "job is the name of 2 services",
    ),
    "middleware": ([], {"RMW_IMPLEMENTATION": "rmw_none"}, "rmw_none"),
    "two inputs in one": (
        ["-r", "load_torque:=engine_speed"],
        {},
        "engine_speed is the name",
    ),
    "qos of another type": (
        ["-p", "qos_overrides./efficiency.publisher.depth:=many"],
        {},
        "qos_overrides./efficiency.publisher.depth",
    ),
    "qos that is none": (
        ["-p", "qos_overrides./efficiency.publisher.reliability:=often"],
        {},
        "`reliability`: `often`",
    ),
    "qos of negative depth": (
        ["-p", "qos_overrides./engine_speed.subscription.depth:=-3"],
        {},
        "engine_speed",
    ),
    "sim time": (["-p", "use_sim_time:=yes_please"], {}, "use_sim_time"),
    "domain": ([], {"ROS_DOMAIN_ID": "300"}, "ROS_DOMAIN_ID = 300; allowed 0 to 232"),
    "negative domain": ([], {"ROS_DOMAIN_ID": "-1"}, "ROS_DOMAIN_ID = -1; allowed"),
    "locale": (["-p", "model_file:=/tmp/Größe.yaml"], C_LOCALE, "LC_ALL=C.UTF-8"),
    "nobody's home": (
        ["-p", "model_file:=~no_such_user/x.yaml"],
        {},
        "names no home folder",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_mistake_at_the_start_is_one_line_and_exit_code_2(case, environment, tmp_path):
    arguments, variables, words = REFUSED[case]
    ended = subprocess.run(
        command(f"state_folder:={tmp_path / 'state'}", arguments=tuple(arguments)),
        env={**environment, "PYTHONPATH": str(ROOT), **variables},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 2, ended.stderr
    assert "Traceback" not in ended.stderr
    last = ended.stderr.splitlines()[-1]
    assert last.startswith("hmcvt: error: ") and words in last


@pytest.mark.parametrize("full", [True, False])
def test_parameter_file_on_a_pipe_is_refused(full, environment, tmp_path):
    """Full, as of `<(...)`, or one that nobody writes to."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDWR) if full else None
    if end is not None:
        os.write(end, b"/**:\n  ros__parameters:\n    input_timeout: -1.0\n")
    ended = subprocess.run(
        command(arguments=("--params-file", str(pipe))),
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if end is not None:
        os.close(end)
    assert ended.returncode == 2
    words = f"hmcvt: error: --params-file {pipe}: is no regular file\n"
    assert ended.stderr == words


def test_relative_file_in_a_working_directory_that_is_gone(environment, tmp_path):
    start = [*IN_NO_FOLDER, str(tmp_path / "gone"), *command("model_file:=my.yaml")]
    ended = subprocess.run(
        start,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 2, ended.stderr
    assert "the working directory was removed" in ended.stderr.splitlines()[-1]


def test_working_directory_that_is_removed_is_told_and_breaks_no_answer(
    start_node, paper_file, table2, tmp_path, monkeypatch
):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    folder = tmp_path / "work"
    folder.mkdir()
    node = start_node(paper_file, launcher=(*IN, str(folder)))
    folder.rmdir()
    words = "the working directory was removed"
    assert node.reports(DiagnosticStatus.WARN, words, send=GOOD), node.status()
    assert node.player.hold(GOOD).efficiency > 0.0
    send_table(node, table2)


def test_file_system_without_locks_is_a_warning_that_stays(
    start_node, paper_file, tmp_path, monkeypatch
):
    if shutil.which("cc") is None:
        pytest.skip("needs a compiler: cc")
    monkeypatch.setenv("SHIM_NO_LOCKS", "1")
    node = start_node(paper_file, launcher=Shim(tmp_path).launcher)
    for _ in range(2):
        assert node.reports(DiagnosticStatus.WARN, "cannot be locked", send=GOOD)


def test_overrides_that_silence_an_input_are_told(connect, environment, tmp_path):
    """The client offers best effort, which a reliable subscription does not hear."""
    override = "qos_overrides./silenced/engine_speed.subscription.reliability"
    misspelt = "qos_overrides./misspelt.publisher.depth"
    client = connect("/silenced")
    words = command(
        f"state_folder:={tmp_path}",
        f"{override}:=reliable",
        f"{misspelt}:=3",
        arguments=("-r", "__ns:=/silenced"),
    )
    with subprocess.Popen(words, env={**environment, "PYTHONPATH": str(ROOT)}) as node:

        def told():
            status = client.statuses.get("inputs", {"message": "", "level": None})
            return (
                status["level"] == DiagnosticStatus.WARN
                and "engine_speed: nothing comes from 1 publisher(s)"
                in status["message"]
                and f"{misspelt} is unknown" in status["message"]
            )

        try:
            assert client.wait_until(told, 30.0), client.statuses
        finally:
            node.kill()


def test_two_publishers_of_the_clock_are_told(sim_node):
    clocks = [sim_node.player.create_publisher(Clock, "/clock", 1) for _ in range(2)]
    assert sim_node.reports(
        DiagnosticStatus.WARN, "2 publishers on /clock", part="inputs"
    ), sim_node.status("inputs")
    for clock in clocks:
        sim_node.player.destroy_publisher(clock)


def test_second_publishers_and_nodes_of_the_same_name_are_told(start_node, paper_file):
    node = start_node(paper_file)
    own = [
        node.player.create_publisher(Float64, topic, 1)
        for topic in ("engine_speed", "efficiency")
    ]
    same_name = Node("hmcvt", context=node.player.context, namespace=node.namespace)
    words = ("engine_speed: 2 publishers", "efficiency: 2 publishers", "another node")
    assert node.reports(DiagnosticStatus.WARN, *words, part="inputs", send=GOOD)
    same_name.destroy_node()
    for publisher in own:
        node.player.destroy_publisher(publisher)
    assert node.reports(DiagnosticStatus.OK, part="inputs", send=GOOD, timeout=20.0)


@pytest.mark.parametrize("name", ["model_file", "engine_file", "vehicle_file"])
def test_pipe_in_place_of_a_file_is_refused(environment, tmp_path, name):
    os.mkfifo(tmp_path / "pipe.yaml")
    ended = subprocess.run(
        command(f"state_folder:={tmp_path / 'state'}", f"{name}:={tmp_path}/pipe.yaml"),
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].endswith("pipe.yaml: is no regular file")


def test_terminal_that_is_closed_ends_it_in_order(start_node, paper_file):
    # Tests that run under nohup ignore the signal, and so would the node.
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        node = start_node(paper_file)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert node.stop(signal.SIGHUP) == 0


def test_home_folder_in_a_parameter(environment, tmp_path, start_node, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    shutil.copy(hmcvt.data_path("params/hm4.yaml"), tmp_path / "mine.yaml")
    node = start_node("~/mine.yaml", state="~/state of mine")
    assert node.comes(lambda: node.value("file") == "mine.yaml")
    assert (tmp_path / "state of mine").is_dir()


def test_folders_with_spaces_do_not_leave_the_machine(tmp_path):
    state = tmp_path / "my state" / "hmcvt"
    model = tmp_path / "secret customer, GmbH" / "unit.yaml"
    public = PublicText(state, [str(model)])
    for text, shown in (
        (f"{state}/models/0001.yaml serves", "models/0001.yaml serves"),
        (f"{model}: is damaged", "unit.yaml: is damaged"),
        (f"state_folder: {state} was removed", "state_folder: hmcvt was removed"),
        (f"[Errno 2] No such file: '{model}'", "[Errno 2] No such file: 'unit.yaml'"),
        (f"serving {tmp_path}/other/params/hm4.yaml", "serving hm4.yaml"),
        (f"{tmp_path.parent}/a/b.csv: row 2", "b.csv: row 2"),
        ("/usr/lib/x.so", "x.so"),
        ("1 / 2 and a/b", "1 / 2 and a/b"),
    ):
        assert public(text) == shown
        assert public.names_folders(text) == (text != shown)


def test_what_has_no_effect_at_the_start_is_told(start_node, paper_file, tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "efficiency_node:\n  ros__parameters:\n    optimum_hold: output_speed\n"
    )
    node = start_node(
        paper_file,
        arguments=("--params-file", str(tmp_path / "mine.yaml")),
        vehicle_file=hmcvt.data_path("params/vehicle.yaml"),
    )
    words = (
        f"mine.yaml has no parameters for {node.namespace.strip('/')}/hmcvt",
        "vehicle_file has no effect without engine_file",
    )
    assert node.reports(DiagnosticStatus.WARN, *words, part="inputs", send=GOOD)


def test_publishers_that_cannot_be_heard_are_told(start_node, paper_file):
    node = start_node(paper_file)
    stranger = Node("stranger", context=node.player.context, namespace=node.namespace)
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    stranger.create_publisher(Float32, "oil_temperature", 1)
    stranger.create_publisher(Int32, "session", 1)
    stranger.create_publisher(JointState, "bench_sample", best_effort)
    words = (
        "oil_temperature: stranger is not heard: it publishes std_msgs/msg/Float32",
        "session: stranger is not heard: Volatile publisher",
        "bench_sample: stranger is not heard: Best effort publisher",
    )
    assert node.reports(
        DiagnosticStatus.WARN, *words, part="inputs", send=GOOD, timeout=20.0
    ), node.status("inputs")
    stranger.destroy_node()
    assert node.reports(DiagnosticStatus.OK, part="inputs", send=GOOD, timeout=20.0)

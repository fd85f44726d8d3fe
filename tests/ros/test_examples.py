# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The examples over ROS: those beside a node, which ask for what is best, and `make demo`."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from ros_bench import send_table
from sensor_msgs.msg import JointState

import hmcvt_core as hmcvt

pytestmark = pytest.mark.slow
SCRIPT = Path(__file__).resolve().parents[2] / "examples" / "control_stack.py"
NOW = (209.4, 200.0)  # engine speed, load torque that the pretended tractor starts from


@pytest.fixture
def run(environment):
    """Start the script; it is gone when the test ends."""
    processes = []

    def start(*arguments, script=SCRIPT.name):
        processes.append(
            subprocess.Popen(
                [sys.executable, str(SCRIPT.with_name(script)), *arguments],
                env={**environment, "PYTHONPATH": str(Path(hmcvt.__file__).parents[1])},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def best(model):
    """The pair that the script has to find."""
    return model.optimal_displacement_ratio(
        *NOW, hold="output_speed", displacement_ratio=-0.8
    )


def served(node, folder):
    path = folder / "served.yaml"
    path.write_text(node.player.model_text)
    return hmcvt.load_model(path)


def test_it_commands_the_best_pair_and_follows_a_refit(node, table2, run, tmp_path):
    before = best(served(node, tmp_path))
    send_table(node, table2)
    commands = []
    node.player.create_subscription(JointState, "cvt_command", commands.append, 10)
    process = run("--seconds", "60", "--pretend", "--namespace", node.namespace)
    assert node.player.wait_until(lambda: len(commands) > 3, 20.0)
    assert list(commands[0].name) == ["engine", "displacement"]
    assert commands[0].velocity[0] == pytest.approx(before.engine_speed, rel=2e-3)
    assert node.player.call("reidentify").success
    after = served(node, tmp_path)
    # From where the tractor is, on the line of the ground speed and power that it keeps.
    wanted = after.optimal_displacement_ratio(
        before.engine_speed,
        before.load_torque,
        hold="output_speed",
        displacement_ratio=before.displacement_ratio,
    )
    assert wanted.engine_speed != pytest.approx(before.engine_speed, rel=0.01)

    def arrived():
        return commands[-1].velocity[0] == pytest.approx(wanted.engine_speed, rel=2e-3)

    assert node.player.wait_until(arrived, 10.0), (wanted, commands[-1])
    assert commands[-1].position[1] == pytest.approx(
        wanted.displacement_ratio, abs=5e-3
    )
    # The pretended tractor follows: the node reports what was promised, and goes on doing so.
    assert node.comes(
        lambda: (
            node.player.efficiencies[-9:]
            == pytest.approx([wanted.efficiency] * 9, abs=1e-3)
        )
    ), (wanted, node.player.efficiencies[-9:])
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=10)
    assert process.returncode == 0 and "Traceback" not in errors, errors
    assert f"efficiency {node.player.efficiencies[-1]:.3f}" in output.splitlines()[-1]
    assert f"model {after.fingerprint}" in errors


def test_a_field_cycle_by_the_stage_and_engine_speed_of_the_node(start_node, run):
    files = [hmcvt.data_path(f"params/{name}.yaml") for name in ("tractor", "engine")]
    node = start_node(files[0], engine_file=files[1], optimum_hold="output_speed")
    process = run("--namespace", node.namespace, script="field_cycle_ros.py")
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 0, errors
    model, engine = hmcvt.load_model(files[0]), hmcvt.load_engine(files[1])
    lines = re.findall(
        r"^(?:[\w, ]+?) +(\d+) +(\d+)  +(\w+) +(\d+) r/min", output, re.MULTILINE
    )
    assert len(lines) == 6
    for speed, power, stage, turns in lines:
        best = model.optimal_drive(
            float(speed) / 3.6 / 0.85 * 21.0, 1e3 * float(power), engine=engine
        )
        assert stage == best.stage
        assert float(turns) == pytest.approx(
            best.engine_speed * 30.0 / 3.14159265, abs=3.0
        )
    assert re.search(
        r"cycle: [\d.]+ kg by the optimum, [\d.]+ kg by the rule: [1-9]", output
    )


def test_a_mission_by_the_causal_strategy_of_the_node(start_node, run):
    model, engine, vehicle = (
        hmcvt.data_path(f"params/{name}.yaml")
        for name in ("tractor", "engine", "vehicle")
    )
    node = start_node(
        model, engine_file=engine, vehicle_file=vehicle, optimum_hold="output_speed"
    )
    process = run(
        *("--namespace", node.namespace, "--mission", "ploughing", "--seconds", "20"),
        script="field_cycle_ros.py",
    )
    output, errors = process.communicate(timeout=90)
    assert process.returncode == 0, errors
    fuel = dict(re.findall(r"^(\w+) +([\d.]+) ", output, re.MULTILINE))
    assert float(fuel["node"]) == pytest.approx(float(fuel["causal"]), rel=0.01)


def test_without_a_node_it_says_so(run):
    began = time.monotonic()
    process = run("--seconds", "1", "--pretend", "--namespace", "/nobody")
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1 and time.monotonic() - began < 10.0
    assert errors == "no command: model or inputs did not come; does the node run?\n"


def test_script_of_the_page_saves_the_model(environment, node, tmp_path):
    page = (SCRIPT.parents[1] / "docs" / "live-view.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    # The page is about a node without a namespace.
    spaced = code.replace("BenchPlayer()", f"BenchPlayer(namespace={node.namespace!r})")
    assert spaced != code
    subprocess.run(
        [sys.executable, "-c", spaced],
        cwd=tmp_path,
        check=True,
        timeout=60,
        env={**environment, "PYTHONPATH": str(Path(hmcvt.__file__).parents[1])},
    )
    saved = hmcvt.load_model(tmp_path / "served.yaml")
    assert saved.fingerprint == served(node, tmp_path).fingerprint


def processes_with(text: str) -> list[str]:
    """Command lines of running processes that hold a text."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue  # it ended meanwhile
        if text in line:
            found.append(line)
    return found


def demo(temporary: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(SCRIPT.with_name("demo.py"))],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )


def test_it_shows_that_the_refit_improves_the_node(environment, tmp_path):
    process = demo(tmp_path)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    rows = re.findall(
        r"^ +([1-8])[* ] +[-+]\d\.\d\d .*\|.*\|", output, flags=re.MULTILINE
    )
    assert rows == list("12345678") * 2
    assert "silent" not in output
    changes = re.findall(r"([\d.]+) %  -> +([\d.]+) %", output)
    assert len(changes) == 2
    for before, after in changes:
        assert float(before) > 20.0 and float(after) < 2.3
    assert processes_with(str(tmp_path)) == []
    assert list(tmp_path.glob("hmcvt-demo-*")) == []


def test_interrupted_it_leaves_nothing_behind(environment, tmp_path):
    process = demo(tmp_path)
    while "1. The node runs" not in process.stdout.readline():
        assert process.poll() is None
    assert processes_with(str(tmp_path))
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 130, output
    assert "the node has been stopped" in output
    assert processes_with(str(tmp_path)) == []
    assert list(tmp_path.glob("hmcvt-demo-*")) == []

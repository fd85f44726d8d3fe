# SPDX-License-Identifier: Apache-2.0
"""How the process starts and ends."""

from __future__ import annotations

import signal
import subprocess

import pytest
from ros_bench import GOOD, command

import hmcvt_core as hmcvt


def run(environment, *parameters, arguments=()):
    return subprocess.run(command(*parameters, arguments=arguments), env=dict(environment),
                          capture_output=True, text=True, timeout=20)


@pytest.mark.parametrize(("parameter", "words"), [
    ("model_file:=/nowhere/x.yaml", ["/nowhere/x.yaml", "No such file"]),
    ("input_timeout:=1", ["input_timeout", "write 1.0"]),
    ("input_timeout:=100.0", ["input_timeout", "0.01 to 60 s"]),
    ("input_timeout:=.nan", ["input_timeout", "0.01 to 60 s"]),
    ("optimum_hold:=ground", ["optimum_hold", "engine_speed, output_speed"]),
    ("map_points:=[400, 400, 400]", ["map_points", "100000"]),
    ("engine_speed_limits:=[750.0, 2200.0]", ["engine_speed_limits", "10 to 320 rad/s"]),
])
def test_wrong_parameter_is_one_line_and_exit_code_2(
    environment, tmp_path, paper_file, parameter, words
):
    result = run(environment, f"model_file:={paper_file}", f"state_folder:={tmp_path}", parameter)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("hmcvt: error: ")
    assert all(word in result.stderr for word in words), result.stderr


def published(paper_file):
    lines = paper_file.read_text().splitlines(keepends=True)
    kept = "".join(line for line in lines if not line.startswith("checksum:"))
    return kept.replace("power_balance", "published")


def test_damaged_model_file_is_one_line_and_exit_code_2(environment, tmp_path, paper_file):
    text = paper_file.read_text()
    for name, damage, word in [
        ("cut.yaml", text[: len(text) // 2], "cut.yaml"),
        ("edited.yaml", text.replace("0.0333", "0.0334"), "checksum"),
        ("empty.yaml", "", "empty"),
        ("published.yaml", published(paper_file), "'published' is not served"),
    ]:
        path = tmp_path / name
        path.write_text(damage)
        result = run(environment, f"model_file:={path}", f"state_folder:={tmp_path}")
        assert result.returncode == 2
        assert result.stderr.count("\n") == 1 and word in result.stderr, result.stderr


@pytest.mark.parametrize(("arguments", "words"), [
    (("--params-file", "/nowhere.yaml"), "Couldn't parse params file"),
    (("-z",), "-z"),
    (("--", "--model", "x.yaml"), "unknown argument --model"),
])
def test_wrong_argument_is_told(environment, arguments, words):
    result = run(environment, arguments=arguments)
    assert result.returncode == 2
    last = result.stderr.splitlines()[-1]
    assert last.startswith("hmcvt: error: ") and words in last
    assert "Traceback" not in result.stderr


def test_help_is_printed(environment):
    result = run(environment, arguments=("--", "--help"))
    assert result.returncode == 0 and result.stderr == ""
    assert result.stdout.startswith("usage: hmcvt-node") and "input_timeout [s]" in result.stdout


@pytest.mark.parametrize(("number", "busy"), [
    (signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGTERM, True)])
def test_signal_ends_it_with_code_0(start_node, paper_file, number, busy):
    node = start_node(paper_file)
    for _ in range(20 if busy else 0):
        node.player.send_inputs(GOOD)
    assert node.stop(number) == 0, node.log
    assert "Traceback" not in node.log
    assert "stopping: asked to by a signal" in node.log


def test_unknown_parameter_is_told(start_node, paper_file):
    node = start_node(paper_file, inputtimeout=1.0)
    assert node.says("parameter inputtimeout is unknown and has no effect")


def test_shipped_model_is_the_default(start_node):
    node = start_node("''")
    shipped = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    assert shipped.fingerprint in node.player.model_text
    assert node.says("the model that comes with hmcvt is served")


def test_a_model_that_was_named_is_no_reason_to_warn(start_node, paper_file):
    node = start_node(paper_file)
    assert node.says("serving ") and "comes with hmcvt" not in node.log


def test_damaged_state_does_not_stop_the_node(start_node, paper_file, tmp_path):
    (tmp_path / "in_service.json").write_text('{"base": ')
    (tmp_path / "bench_samples.csv").write_text("stamp,displ")
    node = start_node(paper_file, state=tmp_path)
    assert node.says("in_service.json: cannot be read")
    assert node.says("damaged lines taken out")
    assert node.player.hold(GOOD).efficiency is not None


def test_unusable_state_folder_does_not_stop_the_node(start_node, paper_file, tmp_path):
    (tmp_path / "file").write_text("")
    node = start_node(paper_file, state=tmp_path / "file" / "state")
    assert node.says("state_folder")
    assert node.player.hold(GOOD).efficiency is not None
    assert not node.player.call("reidentify").success

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A full disk, a folder that cannot be written, a folder that two nodes want, leftovers."""

import resource
import subprocess
from pathlib import Path

import numpy as np
import pytest
from cli.running import BOUND_BY_PERMISSIONS
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, command, file_limit, message, read_only, send_table

import hmcvt_core as hmcvt
from hmcvt_core.files.atomic import write_atomically
from hmcvt_ros.bench_log import BenchLog, rows_of
from hmcvt_ros.state_folder import StateFolder

pytestmark = pytest.mark.slow


def serves(node, paper_file):
    expected = hmcvt.load_model(paper_file).efficiency(*GOOD)
    return node.player.hold(GOOD).efficiency == pytest.approx(expected, rel=1e-12)


def logs_again(node, table2):
    before = node.logged()
    node.player.send_sample(message(table2, 0))
    assert node.comes(lambda: node.logged() == before + 1), node.status()
    assert node.reports(DiagnosticStatus.OK, "serving")
    assert len(hmcvt.read_bench(node.bench_file)) == before + 1


def test_full_disk_while_logging(start_node, paper_file, table2, tmp_path):
    # A log larger than all else that a node writes.
    state, count = tmp_path / "state", 20_000
    column = np.full(count, 0.5)
    state.mkdir()
    BenchLog(state / "bench_samples.csv", 10 * count).write(
        rows_of(
            hmcvt.BenchSamples(
                displacement_ratio=column,
                engine_speed=200.0 * column,
                load_torque=400.0 * column,
                efficiency=column,
                output_speed=200.0 * column,
                stamp=np.arange(float(count)),
            )
        )
    )
    node = start_node(paper_file, state=state)
    whole = node.bench_file.read_bytes()
    with file_limit(len(whole) + 10, node.process.pid):
        for i in range(3):
            node.player.send_sample(message(table2, i))
        assert node.reports(DiagnosticStatus.ERROR, "bench log", "File too large"), (
            node.log
        )
        assert serves(node, paper_file)
        assert node.value("bench samples logged") == str(count)
        assert node.value("bench samples refused, not written") == "3"
        assert node.bench_file.read_bytes() == whole
    logs_again(node, table2)


def test_full_disk_while_refitting(node, paper_file, table2):
    send_table(node, table2)
    before = set(node.state.glob("models/*"))
    # Less than a parameter file needs.
    with file_limit(1000, node.process.pid, *node.children()):
        reply = node.player.call("reidentify")
        assert not reply.success and "File too large" in reply.data["error"], reply.data
        assert "'models/0" in reply.data["error"]
        assert node.comes(lambda: "failed: [Errno" in node.value("last refit"))
        assert serves(node, paper_file)
        children = node.children()
    assert set(node.state.glob("models/*")) == before
    for worker in children:  # it may have inherited the limit
        resource.prlimit(
            worker, resource.RLIMIT_FSIZE, resource.prlimit(0, resource.RLIMIT_FSIZE)
        )
    assert node.player.call("reidentify").success


@pytest.fixture(scope="module")
def bound(start_node, paper_file, tmp_path_factory):
    """A node that permissions bind, started in a folder that it may not write; then it may."""
    state = tmp_path_factory.mktemp("bound")
    StateFolder(state).close()
    with read_only(state):
        node = start_node(paper_file, state=state, launcher=BOUND_BY_PERMISSIONS)
        assert node.says(f"state_folder: {state} cannot be written")
        # Everybody reads diagnostics: they show no folders of the machine.
        assert node.reports(
            DiagnosticStatus.ERROR, f"state_folder: {state.name} cannot be written"
        )
        assert serves(node, paper_file)
    return node


def test_start_in_a_read_only_folder_is_told_before_a_sample_is_lost(bound, table2):
    logs_again(bound, table2)


def test_folder_turns_read_only_and_back(bound, paper_file, table2):
    send_table(bound, table2)
    with read_only(bound.state, bound.bench_file):
        bound.player.send_sample(message(table2, 0))
        assert bound.reports(DiagnosticStatus.ERROR, "bench log", "Permission denied")
        for service in ("reidentify", "clear_samples"):
            reply = bound.player.call(service)
            assert not reply.success and "Permission denied" in reply.data["error"]
        assert serves(bound, paper_file)
    logs_again(bound, table2)


def test_refit_that_cannot_be_put_into_service(bound, paper_file):
    models = bound.state / "models"
    models.mkdir(exist_ok=True)
    with read_only(bound.state):  # but not the folder of the models
        reply = bound.player.call("reidentify")
        assert not reply.success and "in_service.json" in reply.data["error"], (
            reply.data
        )
        assert serves(bound, paper_file)
    assert [path.name for path in models.iterdir()] == ["0001.yaml"]
    reply = bound.player.call("reidentify")
    assert reply.success and Path(reply.data["file"]).name == "0002.yaml"


def test_second_node_on_one_state_folder_does_not_start(node, environment, paper_file):
    given = command(f"model_file:={paper_file}", f"state_folder:={node.state}")
    second = subprocess.run(
        given, env=dict(environment), capture_output=True, text=True, timeout=30
    )
    assert second.returncode == 2
    assert second.stderr.startswith(
        f"hmcvt: error: state_folder: {node.state} is in use by"
    )
    assert second.stderr.count("\n") == 1


def test_leftovers_of_killed_writes_are_removed_and_nothing_else(tmp_path, monkeypatch):
    kept = [
        ".bench.csv.swp",
        ".notes.tmp",
        "x.yaml.abcdefgh.tmp",
        ".x.yaml.ABCDEFGH.tmp",
        "bench_samples.csv",
        "models/.hidden",
        "models/0001.yaml",
    ]
    (tmp_path / "models").mkdir()
    for name in kept:
        (tmp_path / name).write_text("")
    left = set(tmp_path.rglob("*"))
    # What a write makes first, and a kill before the rename leaves.
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", lambda *_: None)
        for name in ("in_service.json", "models/0002.yaml"):
            write_atomically(tmp_path / name, "text")
    assert len(set(tmp_path.rglob("*")) - left) == 2
    StateFolder(tmp_path).close()
    assert set(tmp_path.rglob("*")) - {tmp_path / "starts.json"} == left


def test_state_folder_is_taken_once_and_given_back(tmp_path):
    first = StateFolder(tmp_path / "a" / "b")
    assert first.writable and first.complaint == ""
    under_way = first.path / ".x.yaml.abcdefgh.tmp"
    under_way.write_text("")
    with pytest.raises(hmcvt.InputError, match="in use by another node"):
        StateFolder(first.path)
    assert under_way.exists()
    StateFolder(tmp_path / "a" / "c").close()
    first.close()
    StateFolder(first.path).close()
    assert not under_way.exists()

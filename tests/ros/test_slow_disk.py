# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A slow disk, bursts of bench samples, and a state folder that is not as the node left it."""

import math
import shutil
import signal
import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.qos import QoSProfile
from ros_bench import GOOD, Shim, adopted, message, send_table
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

import hmcvt_core as hmcvt
from hmcvt_ros.model_store import ModelStore
from hmcvt_ros.state_folder import KEPT_STARTS, StateFolder

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a compiler: cc"),
]


@pytest.fixture(scope="module")
def slow(start_node, paper_file, tmp_path_factory):
    """A node, and what makes its disk slow."""
    shim = Shim(tmp_path_factory.mktemp("shim"))
    return start_node(paper_file, launcher=shim.launcher), shim


@pytest.fixture
def node(slow):
    """The node on a disk that is not slow, with an empty log."""
    node, shim = slow
    shim.slow_disk(0.0)
    node.reset()
    return node


def lookups(node, table2, count=300, rate=150.0, every=15):
    """Ask at a rate, and send ten samples a second; the times to the answers [s]."""
    player, times = node.player, []
    (ask,) = (item for item in player._inputs if item.topic.endswith("engine_speed"))
    player.hold(GOOD)
    for i in range(count):
        if i % every == 0:
            player.send_inputs(GOOD)  # the others stay fresh
            player.spin_for(0.02)
            player.send_sample(message(table2, i % len(table2)))
        start = time.monotonic()
        player.efficiencies.clear()
        ask.publish(Float64(data=100.0 + i / count))
        if player.wait_until(lambda: bool(player.efficiencies), 2.0):
            times.append(time.monotonic() - start)
        player.spin_for(max(0.0, 1.0 / rate - (time.monotonic() - start)))
    return times


def test_disk_that_hangs_is_told(node, slow, table2):
    slow[1].slow_disk(9.0)
    node.player.send_sample(message(table2, 0))
    reply = node.player.request("reidentify")
    assert node.comes(
        lambda: "the disk has not answered for" in node.value("state folder"), 10.0
    )
    slow[1].slow_disk(0.0)
    assert node.status()["level"] == DiagnosticStatus.WARN
    assert node.player.hold(GOOD).efficiency is not None
    assert node.comes(reply.done, 15.0) and not reply.result().success
    assert node.player.call("clear_samples").success
    assert node.comes(lambda: node.value("state folder") == "intact")


def test_state_folder_that_is_removed_is_told(start_node, paper_file, table2):
    node = start_node(paper_file)
    shutil.rmtree(node.state)
    assert node.comes(lambda: "was removed or replaced" in node.value("state folder"))
    send_table(node, table2)  # into a new one, which is not the one that was taken
    assert node.comes(lambda: node.status()["level"] == DiagnosticStatus.WARN)
    assert "was removed or replaced" in node.status()["message"]
    assert node.stop() == 0


def test_slow_disk_holds_up_no_lookup(node, slow, table2):
    quick, slowly, answered, sent = 0.0, math.inf, False, 0
    # The machine may do something else meanwhile.
    while sent < 120 and not (answered and slowly <= 2.0 * quick):
        slow[1].slow_disk(0.0)
        before = lookups(node, table2)
        slow[1].slow_disk(0.1)
        times = lookups(node, table2)
        answered = len(before) == len(times) == 300
        sent += 40
        quick, slowly = (
            1e3 * float(np.percentile(found, 99)) for found in (before, times)
        )
        print(f"p99 of a lookup: {quick:.2f} ms, with fsync of 100 ms {slowly:.2f} ms")
    assert answered and slowly <= 2.0 * quick
    # Every sample is on disk, and counted only then.
    assert node.comes(lambda: node.value("bench samples logged") == str(sent), 10.0)
    assert len(hmcvt.read_bench(node.bench_file)) == sent


def test_reply_that_counts_samples_waits_for_all_that_came(node, slow, table2):
    slow[1].slow_disk(0.1)
    for i in range(8):
        node.player.send_sample(message(table2, i))
        node.player.spin_for(0.01)
    reply = node.player.call("clear_samples")
    assert reply.success and reply.data["cleared"] == 8
    assert node.logged() == 0


def counts(node):
    return {
        word: int(node.value(f"bench samples {word}") or 0)
        for word in ("logged", "accepted", "lost", "refused, too many at once")
    }


def test_burst_is_taken_whole(node, table2):
    node.comes(lambda: node.value("bench samples accepted"))
    before = counts(node)
    messages = [message(table2, i) for i in range(8)]
    for i in range(2000):
        messages[i % 8].header.stamp.sec = i + 1
        node.player.send_sample(messages[i % 8])
    assert node.comes(lambda: counts(node)["logged"] == 2000, 20.0), counts(node)
    assert counts(node)["accepted"] - before["accepted"] == 2000
    assert counts(node)["lost"] == before["lost"]
    np.testing.assert_array_equal(
        hmcvt.read_bench(node.bench_file).stamp, np.arange(1.0, 2001.0)
    )


def test_lost_samples_are_counted_and_told(node, table2):
    node.comes(lambda: node.value("bench samples accepted"))
    before, sample = counts(node), message(table2, 0)
    publisher = node.player.create_publisher(
        JointState, "bench_sample", QoSProfile(depth=20)
    )
    assert node.comes(publisher.get_subscription_count, 10.0)
    publisher.publish(sample)
    assert node.comes(lambda: node.logged() == 1)
    node.process.send_signal(signal.SIGSTOP)
    for _ in range(
        1500
    ):  # what the middleware holds in between takes some, but not all
        publisher.publish(sample)
    node.process.send_signal(signal.SIGCONT)
    # The other publisher goes on: the gap is not one of its.
    assert node.comes(lambda: counts(node)["lost"] > before["lost"], 20.0)
    node.player.send_sample(sample)

    def found():
        now = counts(node)
        return (now["lost"] - before["lost"], now["accepted"] - before["accepted"])

    assert node.comes(lambda: sum(found()) == 1502, 20.0), found()
    lost, accepted = found()
    assert lost > 0 and node.logged() == accepted
    assert node.status()["level"] == DiagnosticStatus.WARN
    assert f"{lost} bench samples were sent and not taken" in node.status()["message"]
    node.player.destroy_publisher(publisher)
    assert node.player.call("clear_samples").success
    node.forget_status()
    assert node.comes(lambda: node.value("state folder") == "intact")
    assert counts(node)["lost"] - before["lost"] == lost


# --- the state folder -----------------------------------------------------------------------------


def test_logs_set_aside_are_pruned(start_node, paper_file, table2, tmp_path):
    header = (
        "stamp,displacement_ratio,engine_speed,load_torque,efficiency,output_speed,"
    )
    # The first one was there 30 starts ago.
    for number in range(1, 1001):
        path = tmp_path / f"bench_samples.cleared-{number}.csv"
        path.write_text("mine" if number == 5 else header)
        if number == 1:
            for _ in range(KEPT_STARTS):
                StateFolder(tmp_path).close()
    node = start_node(paper_file, state=tmp_path)
    send_table(node, table2)
    reply = node.player.call("clear_samples")
    assert reply.data["kept_as"].endswith("bench_samples.cleared-1001.csv")
    # The oldest makes room; recent ones and files of others do not.
    names = {path.name for path in node.state.glob("bench_samples.cleared-*.csv")}
    assert len(names) == 1000 and "bench_samples.cleared-1.csv" not in names
    send_table(node, table2)
    refused = node.player.call("clear_samples")
    assert not refused.success and "remove some by hand" in refused.data["error"]
    assert node.logged() == len(table2)


def replace_by(path, content):
    """Replace a file at once: the node may read it at any moment."""
    new = path.with_suffix(".new")
    new.write_bytes(content)
    new.replace(path)


def test_damage_while_it_runs_is_found_before_a_job_works_on_it(
    node, paper_file, table2
):
    send_table(node, table2)
    raw = bytearray(node.bench_file.read_bytes())
    place = raw.index(b",0.", raw.index(b"\n")) + 3
    raw[place] ^= 1  # another digit
    replace_by(node.bench_file, raw)
    node.set(reidentify_min_samples=8)
    reply = node.player.call("reidentify", 60.0)
    assert not reply.success and "7 samples" in reply.data["error"]
    assert node.comes(lambda: "1 damaged lines taken out" in node.value("state folder"))
    assert node.status()["level"] == DiagnosticStatus.WARN

    # The same file under its name comes through the same door.
    replace_by(node.bench_file, raw)
    node.set(samples_file=node.bench_file.name)
    assert "7 samples" in node.player.call("reidentify", 60.0).data["error"]
    aside = node.state / "bench_samples.cleared-9.csv"
    aside.write_bytes(raw)
    node.set(samples_file=aside.name)
    assert "damaged is line 2" in node.player.call("reidentify", 60.0).data["error"]


def test_files_that_are_not_what_was_adopted_are_not_served(
    start_node, paper_file, tmp_path
):
    store = ModelStore(paper_file, tmp_path)
    good = adopted(store, 1e-12)
    first = store.in_service.path
    adopted(store, 2e-12)
    shutil.copy(first, store.in_service.path)  # a valid file, but an older one
    adopted(store, 3e-12)
    store.in_service.path.write_text(
        "schema: hmcvt-model/1\na: &a [x, x]\nb: [*a, *a]\n"
    )
    (tmp_path / "bench_samples.csv").write_text(
        "stamp,displacement_ratio,engine_speed,load_torque,efficiency,output_speed,"
        "stated_std,crc,chain\n1.0,0.5,100.0,200.0,0.8,100.0,,00000000,00000000\n"
    )
    node = start_node(paper_file, state=tmp_path)
    assert node.player.hold(GOOD).efficiency == pytest.approx(
        good.efficiency(*GOOD), rel=1e-12
    )
    assert node.comes(lambda: node.value("file") == "models/0001.yaml")
    assert node.status()["level"] == DiagnosticStatus.WARN
    told = node.value("state folder")
    assert told in node.status()["message"]
    for words in (
        "0003.yaml: not YAML of a parameter file at line 2: 'a' is an alias",
        "0002.yaml: is not what was written: fingerprint",
        "models/0001.yaml serves instead",
        "1 damaged lines taken out",
    ):
        assert words in told, told

    # And while it runs.
    shutil.copy(paper_file, first)
    hmcvt.write_bench(
        tmp_path / "mine.csv", hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    )
    node.set(samples_file="mine.csv")
    reply = node.player.call("reidentify")
    assert (
        not reply.success
        and "0001.yaml: is not what was written" in reply.data["error"]
    )
    assert node.player.call("revert").data["file"] == paper_file.name
    assert node.player.call("clear_samples").success
    node.forget_status()
    assert node.comes(lambda: node.value("state folder") == "intact")


def test_what_waits_for_the_disk_is_written_before_the_end(node, slow, table2):
    before = node.logged()
    slow[1].slow_disk(0.1)
    sample = message(table2, 0)
    for _ in range(200):
        node.player.send_sample(sample)
    node.player.spin_for(1.0)
    assert node.stop() == 0, node.log
    assert node.logged() == before + 200
    assert "Traceback" not in node.log


def test_disk_that_hangs_does_not_hold_up_the_end(
    start_node, paper_file, table2, tmp_path
):
    shim = Shim(tmp_path)
    node = start_node(paper_file, launcher=shim.launcher)
    shim.slow_disk(60.0)
    node.player.send_sample(message(table2, 0))
    assert node.comes(
        lambda: "the disk has not answered for" in node.value("state folder"), 10.0
    )
    start = time.monotonic()
    assert node.stop() == 1
    assert time.monotonic() - start < 5.0  # 2 s, and what an end takes
    assert "the disk does not answer: what waited for it is lost" in node.log
    assert "Traceback" not in node.log

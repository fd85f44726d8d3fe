# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples are logged and watched, the node refits itself from them, and goes back."""

import dataclasses
import itertools
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import RAISED
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, message, points, send_table
from std_msgs.msg import Float64, String

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_core.identification.refit import refit
from hmcvt_ros import jobs, qos
from studies.soak.kill_node import alive
from studies.watch import NOISE, stream, well_known

pytestmark = pytest.mark.slow


def relative_error(node, table2):
    answers = [node.player.hold(point, rounds=2).efficiency for point in points(table2)]
    return np.mean(np.abs(np.array(answers) / table2.efficiency - 1.0))


def test_refit_improves_and_revert_goes_back(node, paper_file, table2):
    assert "no bench samples" in node.player.call("reidentify").data["error"]
    send_table(node, table2)
    before = relative_error(node, table2)

    reply = node.player.call("reidentify")
    assert reply.success, reply.data
    assert node.says(f"{reply.data['file']} ({reply.data['model']}) in service")
    assert reply.data["samples"] == 8
    assert reply.data["error_before"] == pytest.approx(before, rel=1e-9)
    after = relative_error(node, table2)
    assert after < 0.04 < 0.2 < before
    assert reply.data["error_after"] == pytest.approx(after, rel=1e-6)
    compared = reply.data["held_back"]  # its keys: test_node_docs.py
    assert compared["error_in_service"] == pytest.approx(before, rel=1e-9)
    assert after < compared["error_refit"] < 0.1

    # What the core makes of the same file is what the node serves now, on all its topics.
    paper = hmcvt.load_model(paper_file)
    found = refit(hmcvt.read_bench(node.bench_file), paper, paper, seed=0)
    assert reply.data["drift"] == pytest.approx(found.drift)
    assert reply.data["largest_change"] == pytest.approx(found.largest_change)
    refitted = found.model
    assert node.player.hold(GOOD).efficiency == pytest.approx(
        refitted.efficiency(*GOOD), rel=1e-9
    )
    assert node.comes(lambda: reply.data["model"] in node.player.model_text)
    data = (
        node.player.map.data
    )  # 41, 17 and 15 values of the axes, then the efficiencies
    assert data[73 + (20 * 17 + 8) * 15 + 7] == pytest.approx(
        refitted.efficiency(data[20], data[41 + 8], data[41 + 17 + 7]), rel=1e-9
    )

    # The same once more gives the same model, which is no reason to refuse it.
    again = node.player.call("reidentify")
    assert again.success and again.data["model"] == reply.data["model"]
    assert again.data["held_back"]["change"] == pytest.approx(0.0, abs=1e-9)
    assert again.data["file"] == reply.data["file"]

    # It is no new version either.
    assert node.player.call("revert").data["file"] == paper_file.name
    assert node.player.hold(GOOD).efficiency == paper.efficiency(*GOOD)
    reply = node.player.call("revert")
    assert not reply.success
    assert "none before" in reply.data["error"]


def test_no_message_is_dropped_while_the_model_is_swapped(node, table2):
    send_table(node, table2)
    old = node.player.hold(GOOD).efficiency
    models, answers = [], []
    ends = [
        node.player.create_subscription(
            String,
            "hmcvt/model",
            lambda _, info: models.append(info["received_timestamp"]),
            qos.OUTPUT,
        ),
        node.player.create_subscription(
            Float64,
            "efficiency",
            lambda message, info: (
                message.data != old and answers.append(info["received_timestamp"])
            ),
            qos.OUTPUT,
        ),
    ]
    node.player.efficiencies.clear()
    reply = node.player.request("reidentify")
    second = node.player.request("reidentify")
    sent = 0
    for _ in range(1000):
        node.player.send_inputs(GOOD)
        sent += 3
        node.player.spin_for(0.05)
        # A machine that stalls loses what is sent ahead of its answers.
        node.player.wait_until(
            lambda all=sent: len(node.player.efficiencies) >= all, 2.0
        )
        if reply.done() and second.done() and node.player.efficiencies[-1] != old:
            break
    node.player.spin_for(0.3)
    replies = [reply.result(), second.result()]
    assert sorted(answer.success for answer in replies) == [False, True]
    busy = next(answer for answer in replies if not answer.success)
    assert "busy: reidentify has been running for" in busy.message

    received = node.player.efficiencies
    swaps = sum(a != b for a, b in itertools.pairwise(received))
    assert swaps == 1 and received[0] == old
    # One more than sent: the swap itself is answered, the inputs being fresh.
    assert sent <= len(received) <= sent + 1
    # Whoever hears an answer has been sent the model before.
    assert models[0] <= answers[0]
    for end in ends:
        node.player.destroy_subscription(end)


def test_refit_is_not_adopted_over_a_model_it_was_not_compared_with(node, table2):
    send_table(node, table2)
    assert node.player.call("reidentify").success
    running = long_refit(node, table2)
    reverted = node.player.call("revert")
    assert reverted.success
    assert node.comes(running.done, 100.0)
    assert not running.result().success
    assert "changed meanwhile" in running.result().message
    assert reverted.data["model"] in node.player.model_text


def test_few_samples_are_adopted_unchecked_and_say_so(node, table2):
    send_table(node, table2.select([0, 2, 5]))
    reply = node.player.call("reidentify")
    assert not reply.success
    assert "3 samples; reidentify_min_samples = 4" in reply.data["error"]
    node.set(reidentify_min_samples=3)
    reply = node.player.call("reidentify")
    assert reply.success and reply.data["held_back"] is None
    assert any(
        "none could be held out" in warning for warning in reply.data["warnings"]
    )


def test_bench_samples_are_logged_and_bad_ones_refused(start_node, table2):
    """A node of its own, whose counts begin at 0."""
    node = start_node(hmcvt.data_path("params/hm4.yaml"), bench_log_limit=9)
    player = node.player
    send_table(node, table2)
    logged = hmcvt.read_bench(node.bench_file)
    np.testing.assert_allclose(logged.efficiency, table2.efficiency, rtol=1e-12)
    np.testing.assert_allclose(logged.load_torque, table2.load_torque, rtol=1e-12)
    np.testing.assert_array_equal(logged.engine_speed, table2.engine_speed)
    np.testing.assert_array_equal(logged.displacement_ratio, table2.displacement_ratio)
    sent = [message(table2, i).velocity[1] for i in range(8)]
    np.testing.assert_allclose(logged.output_speed, sent, rtol=1e-13)
    assert abs(logged.stamp[-1] - time.time()) < 60.0

    unnamed = message(table2, 0)
    unnamed.name = ["engine", "output", "lever"]
    for refused in [
        unnamed,
        bench_sample_to_message(0.1, math.nan, 100.0, 80.0, 100.0),
        bench_sample_to_message(0.1, 100.0, 100.0, 80.0, 300.0),
        bench_sample_to_message(1.3, 100.0, 100.0, 80.0, 100.0),
    ]:
        player.send_sample(refused)
    assert node.comes(lambda: node.value("bench samples refused, invalid") == "4")
    assert (
        "bench_sample: displacement_ratio = 1.3 is outside"
        in (node.status()["message"])
    )
    for i in range(3):
        player.send_sample(message(table2, i))
    assert node.comes(lambda: "takes no more" in node.status()["message"])
    assert len(hmcvt.read_bench(node.bench_file)) == 9
    assert {
        key: node.value(f"bench samples {key}")
        for key in (
            "logged",
            "received",
            "accepted",
            "refused, log full",
            "refused, not written",
        )
    } == {
        "logged": "9",
        "received": "15",
        "accepted": "9",
        "refused, log full": "2",
        "refused, not written": "0",
    }


def test_samples_file_is_read_and_confined_to_the_state_folder(node, table2, tmp_path):
    hmcvt.write_bench(node.state / "mine.csv", table2)
    hmcvt.write_bench(tmp_path / "outside.csv", table2)
    (node.state / "link.csv").symlink_to(tmp_path / "outside.csv")
    node.set(samples_file="mine.csv")
    reply = node.player.call("reidentify")
    assert reply.success and reply.data["samples"] == 8
    for path in ("../outside.csv", str(tmp_path / "outside.csv"), "link.csv"):
        node.set(samples_file=path)
        reply = node.player.call("reidentify")
        assert not reply.success
        assert "outside the state folder" in reply.data["error"]
    os.mkfifo(node.state / "fifo.csv")
    for path in ("fifo.csv", "."):
        node.set(samples_file=path)
        start = time.monotonic()
        assert (
            f"samples_file = '{path}' is no regular file"
            in (node.player.call("reidentify").data["error"])
        )
        assert time.monotonic() - start < 2.0


def test_page_that_cannot_be_written_costs_the_page_only(
    paper_file, tmp_path, monkeypatch
):
    reports = tmp_path / "reports"
    reports.write_text("a file where the folder should be")
    found = SimpleNamespace(to_dict=lambda: {"verdict": "within noise"})
    monkeypatch.setattr(hmcvt, "diagnose", lambda *_, **__: found)
    answer = jobs.diagnose(hmcvt.data_path("data/table2.csv"), paper_file, 0, reports)
    assert answer["verdict"] == "within noise" and answer["report"] is None
    assert "reports" in answer["report_error"]


def test_samples_of_a_bag_that_is_played_again_count_once(start_node, tmp_path):
    path, model = tmp_path / "p.yaml", well_known()
    hmcvt.save_model(model, path)
    node = start_node(path, bench_noise=NOISE)
    samples = stream(model, 0, "charge_pump", 0.0, samples=12)
    for _ in range(8):
        for i in range(len(samples)):
            sent = message(samples, i)
            sent.header.stamp.sec = 100 + i
            node.player.send_sample(sent)
        node.player.spin_for(0.1)
    assert node.comes(lambda: node.value("bench samples repeated") == "84", 20.0)
    assert node.value("bench samples logged") == "12" == node.value("samples", "gap")
    assert node.status("gap")["level"] == DiagnosticStatus.OK
    assert node.status()["level"] == DiagnosticStatus.OK, node.status()
    assert node.says("were logged before, with the same stamp and values")


def test_diagnosis_answers_without_the_extra_for_pages(paper_file, tmp_path):
    """In a process that finds neither Jinja2 nor matplotlib, as after `pip install .[ros]`."""
    script = f"""
import sys
for name in ("jinja2", "matplotlib"):
    sys.modules[name] = None  # an import of it fails
from pathlib import Path
from hmcvt_ros import jobs
bench = Path({str(hmcvt.data_path("data/table2.csv"))!r})
answer = jobs.diagnose(bench, Path({str(paper_file)!r}), 0, Path({str(tmp_path)!r}))
assert answer["report"] is None and answer["verdict"], answer
assert [path.name for path in Path({str(tmp_path)!r}).iterdir()] == ["0001.json"]
print(answer["report_error"])
"""
    ended = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert "jinja2" in ended.stdout


def test_a_gap_that_opens_is_told_in_diagnostics(start_node, tmp_path):
    path, model = tmp_path / "p.yaml", well_known()
    hmcvt.save_model(model, path)
    node = start_node(path, bench_noise=NOISE)
    samples = stream(model, 0, "charge_pump", 0.03, samples=115)
    speed = model.output_speed(*samples.points[:3])
    samples = dataclasses.replace(samples, output_speed=speed)
    send_table(node, samples.select(range(100)))
    assert node.comes(lambda: node.value("samples", "gap") == "100")
    assert node.status("gap")["level"] == DiagnosticStatus.OK
    assert node.status("gap")["message"].startswith("no gap has opened in 100 samples")

    send_table(node, samples.select(range(100, 115)))
    assert node.comes(lambda: node.value("samples", "gap") == "115")
    found = hmcvt.watch(model, samples, noise=NOISE)
    assert node.status("gap")["level"] == DiagnosticStatus.WARN
    assert node.status("gap")["message"] == str(found) and found.open
    assert node.value("since", "gap") == str(found.since)
    assert float(node.value("size", "gap")) == pytest.approx(found.size, rel=1e-4)
    # It goes on with the model that it has.
    assert node.value("fingerprint") == model.fingerprint
    assert list(node.state.glob("models/*")) == []


@pytest.mark.usefixtures("coarse_maps")
def test_a_baseline_file_reaches_the_diagnosis(paper_file, tmp_path):
    samples = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    sound = tmp_path / "sound.csv"
    hmcvt.write_bench(sound, samples.select(range(0, len(samples), 4)))
    later = tmp_path / "later.csv"
    hmcvt.write_bench(later, samples.select(range(1, len(samples), 4)))
    answer = jobs.diagnose(later, paper_file, 0, tmp_path, 0.004, str(sound))
    assert answer["baseline"]["control"]["verdict"] == "no_gap"
    assert answer["verdict"] == "no_gap" and answer["report"]


# --- the worker, and the end of the node ----------------------------------------------------------


def test_worker_is_kept_and_replaced_when_it_dies(node, table2):
    # Jobs that end at once: they are refused by the worker, which has to read the samples first.
    send_table(node, table2)
    node.set(reidentify_min_samples=9)

    def works():
        return "8 samples" in node.player.call("reidentify").data["error"]

    assert works()
    worker = node.worker()
    is_idle = os.sched_getscheduler(worker) == os.SCHED_IDLE
    assert is_idle or worker in RAISED
    # Where memory runs out, the kernel ends the job and not the node.
    assert (
        oom_score(worker) == 1000
        and oom_score(node.process.pid) == oom_score("self") < 1000
    )
    with open(f"/proc/{worker}/environ") as file:
        assert "OPENBLAS_NUM_THREADS=1" in file.read().split("\0")

    reply = node.player.request("diagnose")
    node.player.spin_for(0.2)  # it takes a second
    assert node.worker() == worker
    os.kill(worker, signal.SIGKILL)
    assert node.comes(reply.done)
    assert "the worker process ended with status -9" in reply.result().message

    assert works()
    other = node.worker()
    assert other != worker
    os.kill(other, signal.SIGKILL)  # while it has nothing to do
    assert node.comes(lambda: not alive(other))
    assert node.comes(works)


def test_model_survives_every_end_and_the_worker_none(start_node, paper_file, table2):
    """One state folder, and nodes that end by a signal and by a kill in the middle of a refit."""
    node = start_node(paper_file)
    send_table(node, table2)
    fingerprint = node.player.call("reidentify").data["model"]
    long_refit(node, table2)
    workers = node.children()
    node.player.send_inputs(GOOD)
    asked = time.monotonic()
    assert node.stop(signal.SIGTERM) == 0, node.log
    assert "InvalidHandle" not in node.log
    assert time.monotonic() - asked < 3.0
    assert "Traceback" not in node.log
    assert "stopping: asked to by a signal" in node.log
    assert node.comes(lambda: not any(map(alive, workers)))

    again = start_node(paper_file, state=node.state)
    assert fingerprint in again.player.model_text
    assert again.says("8 bench samples")
    assert again.comes(lambda: "leakage is not determined" in again.status()["message"])
    again.player.request("reidentify")
    assert again.comes(again.children)
    workers = again.children()
    again.stop(signal.SIGKILL)
    assert again.comes(lambda: not any(map(alive, workers)))


def oom_score(pid):
    """How much rather than others the kernel ends a process where memory runs out, to 1000."""
    return int(Path(f"/proc/{pid}/oom_score_adj").read_text())


def long_refit(node, table2):
    """Call for a refit that takes a second at least, and wait until it runs."""
    hmcvt.write_bench(node.state / "many.csv", table2.select(np.arange(60_000) % 8))
    node.set(samples_file="many.csv")
    return node.running("reidentify")

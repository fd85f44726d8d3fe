# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Refits that can do no harm, and jobs that have limits: attacks on a node over DDS."""

import os
import signal
import subprocess
import sys
import time
import timeit
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from core.test_refit import campaign, worn
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import GOOD, send_table

import hmcvt_core as hmcvt
from hmcvt_ros.worker import Worker
from studies.soak.kill_node import alive

pytestmark = pytest.mark.slow

POINTS = np.meshgrid(
    np.linspace(-1.0, 1.0, 9), np.linspace(90.0, 220.0, 5), np.linspace(100.0, 300.0, 5)
)
MANY = 60_000


@pytest.fixture(scope="module")
def base():
    return hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))


@pytest.fixture(scope="module")
def unit_under_test(start_node):
    return start_node("''")


@pytest.fixture
def node(unit_under_test):
    unit_under_test.reset()
    return unit_under_test


@pytest.fixture
def many(node, base):
    """A job that takes a second at least: it has to read this file."""
    samples = campaign(base, 20, 0).select(np.arange(MANY) % 20)
    hmcvt.write_bench(node.state / "many.csv", samples)
    node.set(samples_file="many.csv")


def apart(one, other):
    """Largest difference between two models [-]."""
    return float(np.abs(one.efficiency(*POINTS) - other.efficiency(*POINTS)).max())


def served(node, reply):
    assert reply.success, reply.data
    return hmcvt.load_model(node.state / reply.data["file"])


def told(node, *words):
    """Wait until the status of the model warns with these words."""
    return node.reports(DiagnosticStatus.WARN, *words, timeout=60.0)


def test_extrapolation_names_the_input_and_its_range(node):
    # The shipped model knows the data that it was identified from.
    for changes, level, *words in (
        ({}, DiagnosticStatus.OK),
        (
            {"engine_speed": 200.0},
            DiagnosticStatus.WARN,
            "extrapolation",
            "engine_speed 200 rad/s is not in 78.54 to 146.6 rad/s (750 to 1400 r/min)",
        ),
        (
            {"engine_speed": 160.0, "load_torque": 350.0},
            DiagnosticStatus.WARN,
            "engine_speed 160",
            "load_torque 350 N m is not in 101.9 to 292.9 N m",
        ),
    ):
        assert node.reports(level, *words, send=GOOD._replace(**changes)), node.status()
        assert (node.value("extrapolation") == "no") == (level == DiagnosticStatus.OK)


def test_one_bad_sample_of_twenty_is_named_and_decides_nothing(node, base):
    unit = worn(base, 3 * (1.2,))
    samples = campaign(unit, 20, 0)
    low = 0.30 * (np.arange(20) == 4)
    send_table(node, replace(samples, efficiency=samples.efficiency - low))
    reply = node.player.call("reidentify")
    assert apart(served(node, reply), unit) < apart(base, unit) + 0.01
    assert reply.data["set_aside"] == [5]
    sentence = reply.data["warnings"][0]
    assert sentence.startswith("row 6 is rejected: it reads")

    # As long as the model serves, and no longer.
    assert told(node, sentence)
    assert sentence in node.value("refit warnings")
    assert float(node.value("drift [-]")) == pytest.approx(
        reply.data["drift"], rel=1e-5
    )
    assert node.player.call("revert").success
    assert node.comes(lambda: node.value("refit warnings") == "none")
    assert node.comes(lambda: node.status()["level"] == DiagnosticStatus.OK)


def test_samples_at_one_stroke_change_nothing_elsewhere(node, base):
    send_table(node, campaign(base, 12, 0, stroke=0.5))
    reply = node.player.call("reidentify")
    assert apart(served(node, reply), base) < 0.01
    assert reply.data["kept"]


def test_samples_that_vanish_from_the_log_are_told(node, base):
    send_table(node, campaign(base, 12, 0))
    assert node.comes(lambda: node.value("bench samples logged") == "12")
    lines = node.bench_file.read_bytes().splitlines(keepends=True)
    node.bench_file.write_bytes(b"".join(lines[:9]))
    refit = node.player.call("reidentify").data
    assert refit.get("samples") == 8, refit
    assert told(node, "gone are samples number 9 to 12")
    node.bench_file.unlink()
    assert "no bench samples" in node.player.call("reidentify").data["error"]
    assert told(node, "is gone, and 8 samples with it")
    assert node.player.call("clear_samples").data == {"cleared": 0, "kept_as": None}
    assert node.comes(lambda: node.value("state folder") == "intact")
    send_table(node, campaign(base, 5, 0))
    node.bench_file.unlink()
    assert node.player.call("clear_samples").success
    assert node.comes(lambda: node.value("bench samples logged") == "0")


def test_drift_over_refits_is_told_and_bounded(node, base):
    node.set(reidentify_max_drift=0.04)
    samples = campaign(base, 40, 0)
    low, lower = (
        replace(samples, efficiency=samples.efficiency - by) for by in (0.03, 0.06)
    )
    send_table(node, low)
    model = served(node, node.player.call("reidentify"))
    assert node.player.call("clear_samples").success
    send_table(node, lower)  # 3 points from the model in service, 6 from the base
    assert (
        "would differ from the base model"
        in node.player.call("reidentify").data["error"]
    )
    assert model.fingerprint in node.player.model_text


def test_staged_refit_waits_for_adopt(node, base):
    assert "no refit is staged" in node.player.call("adopt").data["error"]
    samples = campaign(worn(base, 3 * (1.3,)), 30, 0)
    send_table(node, samples)
    node.set(reidentify_mode="stage")
    before = node.player.hold(GOOD).efficiency
    staged = node.player.call("reidentify").data
    assert staged["staged"] is True
    assert node.comes(lambda: staged["model"] in node.value("staged refit"))
    assert node.player.hold(GOOD).efficiency == before

    path = node.state / staged["file"]
    text = path.read_bytes()
    path.write_bytes(hmcvt.data_path("params/hm4.yaml").read_bytes())
    assert (
        "is not what was written: fingerprint"
        in node.player.call("adopt").data["error"]
    )
    path.write_bytes(text)
    reply = node.player.call("adopt")
    assert reply.data == {"model": staged["model"], "file": staged["file"]}
    assert (
        node.player.hold(GOOD).efficiency
        == served(node, reply).efficiency(*GOOD)
        != before
    )
    assert node.comes(lambda: node.value("staged refit") == "-")
    assert not node.player.call("adopt").success

    # One of samples that have been cleared is of another transmission.
    assert node.player.call("reidentify").data["staged"]
    assert node.player.call("clear_samples").success
    assert "no refit is staged" in node.player.call("adopt").data["error"]


def test_replies_name_no_folder(node, base):
    send_table(node, campaign(base, 8, 0))
    for name in (".", "models", "../samples.csv", "in_service.json"):
        node.set(samples_file=name)
        reply = node.player.call("reidentify")
        assert not reply.success and not set(node.state.parts[1:-1]) & set(
            reply.data["error"].split("/")
        ), reply.data


# --- limits of jobs -------------------------------------------------------------------------------


def ends(node, reply, word):
    """Whether a job fails for a reason, and the next one runs."""
    assert node.comes(reply.done, 60.0)
    assert not reply.result().success and word in reply.result().message, reply.result()
    node.set(samples_file="", reidentify_min_samples=9)
    return "no bench samples" in node.player.call("reidentify").data["error"]


def test_samples_are_not_cleared_during_a_refit(node, many):
    reply = node.running("reidentify")
    refused = node.player.call("clear_samples")
    assert not refused.success
    assert "busy: reidentify has been running for" in refused.data["error"]
    assert "cancelled" in node.player.call("cancel").data
    assert node.comes(reply.done)


def test_job_is_cancelled(node, many):
    reply = node.running("diagnose")
    worker = node.worker()
    assert node.player.call("cancel").data["cancelled"] == "diagnose"
    assert node.comes(lambda: not alive(worker))
    assert ends(node, reply, "ended by ~/cancel")
    assert "no job is running" in node.player.call("cancel").data["error"]
    assert node.comes(lambda: node.status()["level"] == DiagnosticStatus.OK)


def test_job_that_takes_too_long_is_ended(node, many):
    node.set(job_time_limit=1.0)
    reply = node.running("diagnose")
    assert told(node, "diagnose: ended after job_time_limit = 1 s")
    assert ends(node, reply, "ended after job_time_limit = 1 s")


def test_stopped_worker_is_noticed_and_ended(node, many):
    reply = node.running("diagnose")
    worker = node.worker()
    os.kill(worker, signal.SIGSTOP)
    assert told(node, "the worker process was stopped by a signal, and has been ended")
    assert not alive(worker)
    assert ends(node, reply, "was stopped by a signal")


def test_refit_ends_beside_busy_processors(start_node, paper_file, table2):
    node = start_node(paper_file, boosted=False)
    send_table(node, table2)
    with ExitStack() as busy:
        # The worker starts on the processor of the node; the other tests need the others.
        processor = min(os.sched_getaffinity(0))
        os.sched_setaffinity(node.process.pid, {processor})
        other = subprocess.Popen([sys.executable, "-c", "while True: pass"])
        busy.callback(other.wait)
        busy.callback(other.kill)
        os.sched_setaffinity(other.pid, {processor})
        start = time.monotonic()
        reply = node.player.call("reidentify", timeout=90.0)
    assert reply.success and time.monotonic() - start < 60.0, reply
    assert "begun again with a share" in node.log


def test_job_that_needs_too_much_memory_is_ended():
    worker = Worker()
    try:
        work = {"stmt": "bytes(1 << 29)", "number": 1}
        with pytest.raises(MemoryError):
            worker.submit(timeit.timeit, 512, **work).result(timeout=20.0)
        assert worker.submit(timeit.timeit, 2048, **work).result(timeout=20.0) > 0.0
    finally:
        worker.kill()

# SPDX-License-Identifier: Apache-2.0
"""Workers and runs that are killed or interrupted: what was finished stays, the rest is made up."""

import json
import os
import signal
import threading
from pathlib import Path

import pytest

from hmcvt_core import read_bench
from hmcvt_core.files.resources import data_path
from hmcvt_core.fleet.processes import on_processes
from hmcvt_core.fleet.settings import Settings
from hmcvt_core.fleet.study import Broken, Study, Task
from hmcvt_core.model.parameter_file import load_stage

from .fleets import finish, fleet, results, start, wait_for, workers

# With the diagnosis, which takes long enough to be killed in.
SETTINGS = Settings((load_stage(data_path("params/transmission.yaml")),))


def test_killed_worker_loses_nothing(logs, alone, tmp_path):
    running = start("fleet", logs, "--out", tmp_path, "--processes", "2", "--json")
    # In the middle: one log is finished, the others are in hand.
    wait_for(lambda: list(tmp_path.glob("*.json")))
    victim = workers(running.pid)[0]
    os.kill(victim, signal.SIGKILL)
    done = finish(running)
    assert done.code == 0, done
    assert done.out == alone[1].out
    assert results(tmp_path) == results(alone[0])


def test_log_that_kills_its_worker_twice_is_broken(logs):
    tasks = [Task(name, read_bench(logs / f"{name}.csv")) for name in ("00000", "00001")]
    # The first log comes first and, alone at the end, again: its workers are the first, and the
    # one hired after the second log is done.
    killed = []

    def kill_next():
        victim = wait_for(lambda: sorted(set(workers(os.getpid())) - set(killed)))[0]
        killed.append(victim)
        os.kill(victim, signal.SIGKILL)

    killer = threading.Thread(target=kill_next)
    killer.start()
    found = {}
    for name, outcome in on_processes(iter(tasks), SETTINGS, processes=1):
        found[name] = outcome
        if name == "00001":
            # The generator hands out the next log before it tells of this one.
            os.kill(workers(os.getpid())[0], signal.SIGKILL)
    killer.join()
    assert isinstance(found["00001"], Study)
    assert found["00000"] == Broken("killed its worker 2 times (signal 9: Killed)")
    assert workers(os.getpid()) == []


def test_worker_killed_between_logs_is_replaced(logs):
    task = Task("00000", read_bench(logs / "00000.csv"))

    def tasks():
        yield task
        # Asked for the next log once the worker has none in hand.
        for pid in workers(os.getpid()):
            os.kill(pid, signal.SIGKILL)
        wait_for(lambda: not workers(os.getpid()))
        yield task._replace(name="later")

    found = dict(on_processes(tasks(), SETTINGS, processes=1))
    assert {name: type(outcome) for name, outcome in found.items()} \
        == {"00000": Study, "later": Study}


def test_interrupt_keeps_what_is_finished(logs, alone, tmp_path):
    running = start("fleet", logs, "--out", tmp_path, "--processes", "1")
    wait_for(lambda: list(tmp_path.glob("*.json")))
    pids = workers(running.pid)
    running.send_signal(signal.SIGINT)
    done = finish(running)
    assert done.code == 130 and done.out == ""
    assert "hmcvt: error: interrupted" in done.err and "Traceback" not in done.err
    assert pids and not any(os.path.exists(f"/proc/{pid}") for pid in pids)
    kept = len(list(tmp_path.glob("*.json")))
    assert 1 <= kept < 4
    rest = fleet(logs, "--out", tmp_path, "--processes", "2", "--json")
    assert json.loads(rest.out)["counts"]["finished_before"] == kept
    assert results(tmp_path) == results(alone[0])


def test_killed_run_leaves_no_worker_behind(logs, tmp_path):
    running = start("fleet", logs, "--out", tmp_path, "--processes", "2")
    pids = wait_for(lambda: workers(running.pid))
    running.kill()
    done = finish(running)
    assert done.code == -signal.SIGKILL
    wait_for(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in pids))
    assert "Traceback" not in done.err


def test_workers_are_given_one_thread(logs, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    outcomes = on_processes(iter([Task("a", read_bench(logs / "00000.csv"))]), SETTINGS,
                            processes=1)
    threads = {}

    def look():
        pid = wait_for(lambda: workers(os.getpid()))[0]
        environment = wait_for(Path(f"/proc/{pid}/environ").read_bytes)
        threads.update(pair.split(b"=", 1) for pair in environment.split(b"\0") if b"=" in pair)

    looker = threading.Thread(target=look)
    looker.start()
    assert [type(outcome) for _, outcome in outcomes] == [Study]
    looker.join()
    assert {threads[name] for name in (b"OMP_NUM_THREADS", b"OPENBLAS_NUM_THREADS")} == {b"1"}


def test_error_while_logs_are_taken_ends_the_workers(logs):
    def tasks():
        yield Task("a", read_bench(logs / "00000.csv"))
        raise OSError("disk gone")

    with pytest.raises(OSError, match="disk gone"):
        list(on_processes(tasks(), SETTINGS, processes=2))
    assert workers(os.getpid()) == []

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Workers and runs that are killed or interrupted: what was finished stays, the rest is made up."""

import multiprocessing
import os
import shutil
import signal
import threading

import pytest

from hmcvt_core import read_bench
from hmcvt_tools.fleet.executors import Processes, study_all
from hmcvt_tools.fleet.run import Study

from .fleets import WORK, finish, results, start, wait_for, workers

pytestmark = pytest.mark.slow


@pytest.fixture
def tasks(logs):
    return [(path.stem, read_bench(path)) for path in sorted(logs.glob("*.csv"))]


def kill(process):
    os.kill(process.pid, signal.SIGKILL)
    process.join()


def test_log_that_kills_its_worker_twice_is_broken(tasks):
    # The first log comes first and, alone at the end, again.
    found, first = (
        {},
        threading.Thread(
            target=lambda: kill(wait_for(multiprocessing.active_children)[0])
        ),
    )
    first.start()
    for name, outcome in study_all(WORK, iter(tasks), Processes(1)):
        found[name] = outcome
        if len(found) == 2:
            kill(*multiprocessing.active_children())
    first.join()
    assert [type(found[name]) for name, _ in tasks] == [str, Study, Study]
    assert found["00000"] == "killed its worker 2 times (memory, most likely)"


def test_worker_killed_between_logs_is_replaced(tasks):
    place = Processes(1)
    place.ahead = 1

    def two():
        yield tasks[0]
        # Asked for the next log when the worker has none in hand.
        kill(multiprocessing.active_children()[0])
        yield tasks[1]

    assert dict(study_all(len, two(), place)) == {"00000": 12, "00001": 12}


def test_logs_are_read_as_there_is_room(tasks):
    read, told = [], []

    def watched():
        for task in 2 * tasks:
            read.append(task)
            assert (
                len(read) - len(told) <= 5
            )  # two by two in hand, one that waits for being told
            yield task

    for name, _ in study_all(len, watched(), Processes(2)):
        told.append(name)
    assert len(told) == 6


def test_interrupt_keeps_what_is_finished(hmcvt, logs, identified, tmp_path):
    many, out = tmp_path / "many", tmp_path / "out"
    many.mkdir()
    for name in (
        f"{number}-{path.name}" for path in logs.glob("*.csv") for number in range(2)
    ):
        shutil.copy(logs / name[2:], many / name)
    arguments = ("fleet", many, "--out", out, "--no-diagnose", "--processes")
    running = start(*arguments, "1", start_new_session=True)
    wait_for(lambda: list(out.glob("*.json")))
    pids = workers(running.pid)
    os.killpg(running.pid, signal.SIGINT)  # as a terminal does
    done = finish(running)
    assert done.code == 130 and done.out == ""
    assert (
        done.err.endswith("hmcvt: error: interrupted\n") and "Traceback" not in done.err
    )
    assert pids and not any(os.path.exists(f"/proc/{pid}") for pid in pids)
    kept = len(list(out.glob("*.json")))
    assert 1 <= kept < len(list(many.iterdir()))
    rest = hmcvt(*arguments, "1", "--json")
    assert rest.json["counts"]["finished_before"] == kept
    # As of the logs, but for their names.
    assert results(out) == {
        f"{number}-{name}": text.replace(f"{name[:5]}.csv", f"{number}-{name[:5]}.csv")
        for name, text in results(identified).items()
        for number in range(2)
    }


@pytest.mark.parametrize(
    "how", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL]
)
def test_ended_run_leaves_no_worker_behind(logs, tmp_path, how):
    running = start(
        "fleet", logs, "--out", tmp_path, "--processes", "2", start_new_session=True
    )
    pids = wait_for(lambda: workers(running.pid))  # which are about to start
    (os.kill if how == signal.SIGKILL else os.killpg)(running.pid, how)
    done = finish(running)
    assert done.code == (130 if how == signal.SIGINT else -how)
    wait_for(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in pids))
    # A worker whose run is killed while it starts has no input to read and says so.
    # Python itself tells, as ignored, where the signal met a file half open.
    assert how == signal.SIGKILL or (
        done.err.endswith("hmcvt: error: interrupted\n")
        and "Traceback" not in done.err.partition("Exception ignored")[0]
    )


def test_workers_are_given_one_thread_and_no_module_of_the_folder(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    monkeypatch.chdir(tmp_path)
    for name in ("random.py", "multiprocessing.py"):
        (tmp_path / name).write_text("raise SystemExit")
    with Processes(1) as executor:
        assert executor.submit(os.getenv, "OMP_NUM_THREADS").result(timeout=60) == "1"
    assert os.environ["OMP_NUM_THREADS"] == "7" and "MKL_NUM_THREADS" not in os.environ


def test_error_while_logs_are_taken_ends_the_workers(tasks):
    def broken():
        yield tasks[0]
        raise OSError("disk gone")

    with pytest.raises(OSError, match="disk gone"):
        list(study_all(len, broken(), Processes(2)))
    assert multiprocessing.active_children() == []

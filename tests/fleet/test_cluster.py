# SPDX-License-Identifier: Apache-2.0
"""The same fleet on a Dask cluster of two worker processes, over loopback."""

import os
import signal
import sys

import pytest
from cli.running import assert_refused

from .fleets import finish, fleet, results, start, wait_for

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, host="127.0.0.1",
            dashboard_address=None) as found:
        yield found


def test_cluster_gives_the_digits_of_one_process(cluster, logs, alone, tmp_path):
    done = fleet(logs, "--out", tmp_path, "--scheduler", cluster.scheduler_address, "--json")
    assert done.code == 0, done
    assert done.out == alone[1].out
    assert results(tmp_path) == results(alone[0])


def test_killed_worker_of_the_cluster_loses_nothing(cluster, logs, alone, tmp_path):
    with distributed.Client(cluster) as client:
        victim = next(iter(client.run(os.getpid).values()))
    running = start("fleet", logs, "--out", tmp_path, "--scheduler", cluster.scheduler_address)
    wait_for(lambda: list(tmp_path.glob("*.json")))
    os.kill(victim, signal.SIGKILL)
    assert finish(running).code == 0
    assert results(tmp_path) == results(alone[0])


def test_nobody_at_the_address(logs, tmp_path):
    done = fleet(logs, "--out", tmp_path, "--scheduler", "nonsense://x")
    assert_refused(done, "--scheduler nonsense://x", "no Dask scheduler answers")


def test_dask_is_needed_for_a_cluster_only(logs, tmp_path, monkeypatch, capsys):
    from hmcvt_core.cli import main

    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit) as stopped:
        main(["fleet", str(logs), "--out", str(tmp_path), "--scheduler", "tcp://127.0.0.1:1"])
    assert stopped.value.code == 2
    assert "pip install '.[fleet]'" in capsys.readouterr().err

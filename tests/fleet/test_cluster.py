# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The same fleet on a Dask cluster of two worker processes, over loopback."""

import os
import signal
import sys
from itertools import count, islice

import pytest
from cli.running import assert_refused

from hmcvt_core import HmcvtError, InputError, read_bench
from hmcvt_tools.fleet import executors
from hmcvt_tools.fleet.executors import on_cluster, study_all
from hmcvt_tools.fleet.run import Study

from .fleets import WORK, results


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
    ) as found:
        yield found


def test_cluster_gives_the_digits_of_one_process(
    hmcvt, cluster, logs, identified, tmp_path
):
    done = hmcvt(
        "fleet",
        logs,
        "--out",
        tmp_path,
        "--no-diagnose",
        "--scheduler",
        cluster.scheduler_address,
    )
    assert done.code == 0, done
    assert results(tmp_path) == results(identified)


def test_other_version_on_the_cluster_is_refused(cluster, monkeypatch):
    monkeypatch.setattr(executors, "__version__", "0.0")
    with (
        pytest.raises(
            InputError, match=r"tcp://\S+: \S+ \S+ needs hmcvt 0.0, there is "
        ),
        on_cluster(cluster.scheduler_address),
    ):
        pass


@pytest.mark.long
def test_killed_worker_loses_nothing_and_a_lost_scheduler_is_told(
    cluster, logs, monkeypatch
):
    monkeypatch.setattr(executors, "_AHEAD", 4)
    samples = read_bench(logs / "00000.csv")
    outcomes = study_all(
        WORK,
        ((str(number), samples) for number in count()),
        on_cluster(cluster.scheduler_address),
    )
    with cluster.get_client() as client:
        victim = next(iter(client.run(os.getpid).values()))
    in_hand = {str(number) for number in range(4)} - {next(outcomes)[0]}
    os.kill(victim, signal.SIGKILL)
    for name, outcome in islice(outcomes, 30):
        assert isinstance(outcome, Study)
        in_hand.discard(name)
        if not in_hand:
            break
    assert not in_hand
    cluster.close()
    with pytest.raises(
        HmcvtError, match="the Dask scheduler is lost; finished logs are kept"
    ):
        list(outcomes)


def test_nobody_at_the_address(hmcvt, logs, tmp_path):
    done = hmcvt("fleet", logs, "--out", tmp_path, "--scheduler", "nonsense://x")
    assert_refused(done, "--scheduler nonsense://x", "no Dask scheduler answers")


def test_dask_is_needed_for_a_cluster_only(hmcvt, logs, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = hmcvt("fleet", logs, "--out", tmp_path, "--scheduler", "tcp://127.0.0.1:1")
    assert_refused(done, 'pip install ".[fleet]"')

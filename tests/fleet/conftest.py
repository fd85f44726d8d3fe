# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import shutil

import pytest
from cli.running import run

from .fleets import make_fleet


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Three logs of 12 samples."""
    return make_fleet(tmp_path_factory.mktemp("fleet"), 3, 12)


@pytest.fixture(scope="session")
def two_logs(logs, tmp_path_factory):
    """The first two of the logs: a diagnosis takes seconds."""
    folder = tmp_path_factory.mktemp("two")
    for path in sorted(logs.glob("*.csv"))[:2]:
        shutil.copy(path, folder)
    return folder


@pytest.fixture(scope="session")
def alone(two_logs, tmp_path_factory):
    """What one process makes of two logs."""
    out = tmp_path_factory.mktemp("alone")
    done = run("fleet", two_logs, "--out", out, "--processes", "1", "--json")
    assert done.code == 0, done
    return out, done


@pytest.fixture(scope="session")
def identified(logs, tmp_path_factory):
    """What one process makes of the logs without diagnosis, which takes nearly all the time."""
    out = tmp_path_factory.mktemp("identified")
    assert (
        run("fleet", logs, "--out", out, "--processes", "1", "--no-diagnose").code == 0
    )
    return out

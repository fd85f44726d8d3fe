# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import pytest
from cli.running import run

from .fleets import make_fleet


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Three logs of 12 samples."""
    return make_fleet(tmp_path_factory.mktemp("fleet"), 3, 12)


@pytest.fixture(scope="session")
def alone(logs, tmp_path_factory):
    """What one process makes of the logs."""
    out = tmp_path_factory.mktemp("alone")
    done = run("fleet", logs, "--out", out, "--processes", "1", "--json")
    assert done.code == 0, done
    return out, done


@pytest.fixture(scope="session")
def identified(logs, tmp_path_factory):
    """The same without diagnosis, which takes nearly all the time."""
    out = tmp_path_factory.mktemp("identified")
    assert (
        run("fleet", logs, "--out", out, "--processes", "1", "--no-diagnose").code == 0
    )
    return out

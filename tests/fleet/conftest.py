# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import shutil

import pytest
from cli.running import hmcvt

from .fleets import make_fleet, run

__all__ = ["hmcvt"]


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
    assert run("fleet", logs, "--out", out, "--processes", "1", "--no-diagnose").code == 0
    return out


@pytest.fixture(scope="session")
def many(logs, tmp_path_factory):
    """A fleet of 12 logs, for runs that are to be stopped half way; without diagnosis."""
    folder = tmp_path_factory.mktemp("many")
    for number in range(4):
        for path in logs.glob("*.csv"):
            shutil.copy(path, folder / f"{number}-{path.name}")
    return folder


@pytest.fixture(scope="session")
def many_identified(many, tmp_path_factory):
    """What one process makes of the many logs."""
    out = tmp_path_factory.mktemp("many-identified")
    assert run("fleet", many, "--out", out, "--processes", "1", "--no-diagnose").code == 0
    return out

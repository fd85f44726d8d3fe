# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import shutil

import pytest
from cli.running import hmcvt

from .fleets import make_fleet, results, run

__all__ = ["hmcvt"]

COPIES = 3


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
    """Copies of the logs, for runs that are to be stopped half way; without diagnosis."""
    folder = tmp_path_factory.mktemp("many")
    for number in range(COPIES):
        for path in logs.glob("*.csv"):
            shutil.copy(path, folder / f"{number}-{path.name}")
    return folder


@pytest.fixture(scope="session")
def many_results(identified):
    """What one process makes of them: as of the logs, but for their names."""
    return {f"{number}-{name}": text.replace(f"{name[:5]}.csv", f"{number}-{name[:5]}.csv")
            for name, text in results(identified).items() for number in range(COPIES)}

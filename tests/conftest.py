# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import os
import signal

# NumPy reads it when it is imported. Tests run side by side: threads of one that wait for a core of
# another take a third of its time.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from hmcvt_core import data_path, read_bench

# The tables of makers are not copied here (docs/studies/units.md).
collect_ignore = [] if "HMCVT_REAL_UNITS" in os.environ else ["units/test_real.py"]


def pytest_configure():
    # A shell that starts the tests in the background has them ignore Ctrl-C, and so would do every
    # process that they start.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def table2():
    return read_bench(data_path("data/table2.csv"))


@pytest.fixture(scope="module")
def coarse_maps():
    """Draw maps of 169 points each; the 625 of a page take a third of its time."""
    from hmcvt_tools.report import gap_map

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gap_map, "_GRID", 13)
        yield


@pytest.fixture
def hmcvt():
    """Run the command in this process."""
    # Here, so that the tests of the core need no library of the commands.
    from cli.running import run

    return run


def pytest_collection_modifyitems(items):
    # Files that take long begin first, lest one process works on alone at the end.
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)

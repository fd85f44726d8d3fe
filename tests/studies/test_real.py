# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The study of real rigs, on a rig made by arithmetic."""

import numpy as np
import pytest

from hmcvt_core.errors import InputError
from studies.real.__main__ import written
from studies.real.judge import BandRun, leak_by_coolers, poor_coolers
from studies.real.rig import is_rig, read_rig

HEAD = "cycle,cooler,pump_leak,accumulator,pressure_bar,flow_L/min,oil_temperature"


@pytest.fixture
def table(tmp_path):
    """Windows of a pump that leaks by gaps, and through an orifice where it is faulty."""
    rng = np.random.default_rng(0)
    rows = ["# made by a test", HEAD]
    for leak, pressure in ((leak, p) for leak in (0, 1) for p in range(100, 220, 2)):
        lost = 0.005 * pressure + leak * 0.02 * np.sqrt(pressure)
        flow = 8.65 - lost + 0.004 * rng.standard_normal()
        rows.append(f"1,100,{leak},90,{pressure},{flow:.4f},36.0")
    path = tmp_path / "rig.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_leak_is_in_the_pump(table):
    assert is_rig(table)
    rig = read_rig(table)
    runs = leak_by_coolers(rig, 1.0)
    assert [run.part for run in runs] == ["pump", "pump"]
    assert all(run.right and run.removed > 0.8 for run in runs)
    assert poor_coolers(rig, True) == []


def test_page_lists_failures_first(table):
    runs = leak_by_coolers(read_rig(table), 1.0)
    page = written(runs, [BandRun("A", "pressure", "flow", 1.0, 2.0, "none")])
    assert page.index("## Comparisons that are wrong") < page.index("cooler 100 %")
    assert "-300 %" in page and "**missed**" in page


def test_a_missing_column_is_named(table):
    table.write_text(table.read_text().replace("oil_temperature", "oil"))
    with pytest.raises(InputError, match="oil_temperature is missing"):
        read_rig(table)

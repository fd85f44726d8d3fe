# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The study of real rigs, on a rig made by arithmetic."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from hmcvt_core.errors import InputError
from studies.real.__main__ import SHIPPED, written
from studies.real.judge import BandRun, leak_by_coolers, poor_coolers
from studies.real.reduce import command as reduce_command
from studies.real.rig import is_rig, read_rig
from studies.units.judge import units_of

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


def test_page_lists_wrong_comparisons_only(table):
    wrong, right = leak_by_coolers(read_rig(table), 1.0)
    wrong = replace(wrong, right=False)
    page = written([wrong, right], [BandRun("A", "pressure", "flow", 1.0, 2.0, "none")])
    assert f"| {wrong.kind} | {wrong.what} |" in page
    assert f"| {right.kind} | {right.what} |" not in page
    assert "-300 %" in page and "**missed**" in page


def test_a_missing_column_is_named(table):
    table.write_text(table.read_text().replace("oil_temperature", "oil"))
    with pytest.raises(InputError, match="oil_temperature is missing"):
        read_rig(table)


def test_shipped_tables_are_read():
    paths = sorted(path for path in SHIPPED.glob("*.csv") if is_rig(path))
    assert [path.name for path in paths] == ["zema_pump.csv"]
    assert len(read_rig(paths[0]).flow) == 577
    units = set()
    for path in SHIPPED.glob("*.csv"):
        if not is_rig(path):
            units |= set(units_of(path))
    assert units == {"ASW:062 (pump)", "S4D (motor)", "C7 (motor)"}


@pytest.fixture
def recordings(tmp_path):
    """Files in the form of the public data set: three cycles, the second not settled."""
    seconds = np.arange(60)
    pressure = np.where(seconds < 30, 150.0, 170.0) + 40.0 * (seconds == 29)
    for name, rate, level in (
        ("PS1", 100, pressure),
        ("FS1", 10, np.full(60, 7.5)),
        ("EPS1", 100, np.full(60, 2300.0)),
        ("TS1", 1, 40.0 + 0.01 * seconds),
    ):
        matrix = np.tile(np.repeat(level, rate), (3, 1))
        np.savetxt(tmp_path / f"{name}.txt", matrix, fmt="%.4f", delimiter="\t")
    profile = [[100, 100, 0, 130, 0], [20, 100, 1, 130, 1], [3, 73, 2, 90, 0]]
    np.savetxt(tmp_path / "profile.txt", profile, fmt="%d", delimiter="\t")
    return tmp_path


def test_public_files_are_reduced_to_windows_with_every_state(recordings):
    out = recordings / "rig.csv"
    done = CliRunner().invoke(reduce_command, [str(recordings), "--out", str(out)])
    assert done.exit_code == 0, done.output
    rig = read_rig(out)
    # Five windows of 5 s before the jump at 29 s, and six from 30 s on, of each settled cycle.
    assert len(rig.flow) == 2 * 11
    assert set(rig.fault.tolist()) == {0.0, 2.0}
    np.testing.assert_allclose(np.unique(rig.pressure), [150e5, 170e5])
    assert "valve" in out.read_text().splitlines()[0]


def test_wrong_recordings_are_named(recordings):
    (recordings / "FS1.txt").write_text("7.5 7.5\n" * 3)
    with pytest.raises(InputError, match=r"FS1\.txt: 2 columns are no multiple"):
        CliRunner().invoke(
            reduce_command,
            [str(recordings), "--out", str(recordings / "rig.csv")],
            catch_exceptions=False,
        )

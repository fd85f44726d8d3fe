"""The same bench samples come out of one recording in every format."""

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt

from . import recordings

pytest.importorskip("asammdf")
pytest.importorskip("nptdms")
pytest.importorskip("can")
pytest.importorskip("cantools")

COLUMNS = ("displacement_ratio", "engine_speed", "load_torque", "efficiency")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    time, columns = recordings.recorded()
    recordings.write_csv(folder / "bench.csv", time, columns)
    recordings.write_mdf(folder / "bench.mf4", time, columns)
    recordings.write_tdms(folder / "bench.tdms", time, columns)
    recordings.write_dbc(folder / "bench.dbc")
    for suffix in ("log", "blf", "asc", "trc"):
        recordings.write_can(folder / f"bench.{suffix}", time, columns)
    return folder


def imported(folder, name, *arguments):
    out = folder / f"samples-{name}.csv"
    run("import", folder / name, "--out", out, "--yes", *arguments)
    return hmcvt.read_bench(out)


@pytest.mark.parametrize("suffix", ["mf4", "tdms", "log", "blf", "asc", "trc"])
def test_tests_of_one_recording(folder, suffix):
    from_csv = imported(folder, "bench.csv")
    assert len(from_csv) == len(recordings.POINTS)
    dbc = ()
    tolerance = 1e-6
    if suffix not in ("mf4", "tdms"):
        dbc = ("--dbc", folder / "bench.dbc")
        tolerance = 5e-4  # steps of 0.05 N m and 0.05 r/min
    samples = imported(folder, f"bench.{suffix}", *dbc)
    assert len(samples) == len(from_csv)
    for name in COLUMNS:
        np.testing.assert_allclose(
            getattr(samples, name), getattr(from_csv, name), rtol=tolerance
        )
    if dbc:
        assert set(samples.extra["stage"]) == {"HM4"}

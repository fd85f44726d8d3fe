# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The same bench samples come out of one recording in every format."""

import tracemalloc

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
from hmcvt_tools.logs.mdf import MdfLog, open_mdf

from . import recordings

asammdf = pytest.importorskip("asammdf")
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


def test_the_same_from_a_bag(folder):
    pytest.importorskip("rosbags")
    from bag.simulated import START, Bench, bench_records, write_bag

    time, columns = recordings.recorded()
    rpm = recordings.RPM
    bench = Bench(
        START + time,
        rpm * columns["n_engine"],
        columns["M_engine"],
        rpm * columns["n_output"],
        columns["M_output"],
        0.01 * columns["PumpStroke"],
        np.zeros(len(time)),
        np.zeros(len(time)),
    )
    bag = write_bag(folder / "bag", bench_records(bench))
    out = folder / "samples-bag.csv"
    run("import-bag", bag, "--out", out)
    from_bag = hmcvt.read_bench(out)
    from_csv = imported(folder, "bench.csv")
    for name in COLUMNS:
        np.testing.assert_allclose(
            getattr(from_bag, name), getattr(from_csv, name), rtol=1e-6
        )


def test_mapping_is_saved_and_applied(folder):
    mapping = folder / "daq.yaml"
    shown = run("import", folder / "bench.mf4", "--out", folder / "none.csv")
    assert shown.code == 0
    assert "n_engine" in shown.out and "would be written" in shown.out
    assert not (folder / "none.csv").exists()
    arguments = ("--dbc", folder / "bench.dbc", "--save-mapping", mapping)
    first = imported(folder, "bench.blf", *arguments)
    out = folder / "next.csv"
    done = run("import", folder / "bench.log", "--mapping", mapping, "--out", out)
    assert done.code == 0, done.err
    np.testing.assert_allclose(hmcvt.read_bench(out).efficiency, first.efficiency)


def test_an_unusual_efficiency_is_asked(folder):
    time, columns = recordings.recorded()
    halved = {**columns, "M_output": 0.75 * columns["M_output"]}
    recordings.write_mdf(folder / "odd.mf4", time, halved)
    done = run("import", folder / "odd.mf4", "--out", folder / "odd.csv", "--yes")
    assert done.code == 2
    assert "the efficiency is 0.56 in the middle" in done.err
    assert "--unchecked" in done.err


def test_units_come_from_the_file(folder):
    time, columns = recordings.recorded()
    in_si = {**columns, "n_engine": recordings.RPM * columns["n_engine"]}
    in_si["n_output"] = recordings.RPM * columns["n_output"]
    units = {**recordings.UNITS, "n_engine": "rad/s", "n_output": "rad/s"}
    recordings.write_mdf(folder / "si.mf4", time, in_si, units)
    from_si = imported(folder, "si.mf4")
    np.testing.assert_allclose(
        from_si.engine_speed, imported(folder, "bench.mf4").engine_speed, rtol=1e-6
    )


def test_torques_without_a_unit_are_asked(folder):
    time, columns = recordings.recorded()
    units = {**recordings.UNITS, "M_engine": "", "M_output": ""}
    recordings.write_mdf(folder / "bare.mf4", time, columns, units)
    done = run("import", folder / "bare.mf4", "--out", folder / "b.csv", "--yes")
    assert done.code == 2 and "M_engine" in done.err
    engine = ("--engine-torque", "M_engine:Nm", "--output-torque", "M_output:Nm")
    done = run(
        "import", folder / "bare.mf4", "--out", folder / "b.csv", "--yes", *engine
    )
    assert done.code == 0, done.err


def test_rates_are_joined_by_time(folder):
    """Engine at 100 Hz, output at 50 Hz with a gap, stroke at 10 Hz."""
    asammdf = pytest.importorskip("asammdf")
    time, columns = recordings.recorded()
    mdf = asammdf.MDF(version="4.10")
    for name, step in (
        ("n_engine", 1),
        ("M_engine", 1),
        ("n_output", 2),
        ("M_output", 2),
        ("PumpStroke", 5),
    ):
        kept = np.arange(0, len(time), step)
        if name == "M_output":
            kept = kept[(time[kept] < 22.0) | (time[kept] > 28.0)]
        unit = recordings.UNITS[name]
        mdf.append(
            asammdf.Signal(columns[name][kept], time[kept], name=name, unit=unit)
        )
    mdf.save(folder / "rates.mf4", overwrite=True)
    mdf.close()
    done = run("import", folder / "rates.mf4", "--out", folder / "r.csv", "--yes")
    assert "M_output from 21.980 s: 1 gaps" in done.out
    samples = hmcvt.read_bench(folder / "r.csv")
    # The third point has no output torque for 6 of its 10 s.
    assert len(samples) == 4
    whole = imported(folder, "bench.csv")
    np.testing.assert_allclose(
        samples.efficiency, whole.efficiency[[0, 1, 3, 4]], rtol=2e-3
    )


def test_a_piece_of_a_file_of_many_channels_is_held(tmp_path):
    """What asammdf returns are views of all channels' records; they must not pile up."""
    readings = 200_000
    channels = 20
    time = 1e-3 * np.arange(readings)
    signals = [
        asammdf.Signal(time + number, time, name=f"channel{number}")
        for number in range(channels)
    ]
    path = tmp_path / "wide.mf4"
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append(signals)
        mdf.save(path, compression=0)
    del signals
    count = 0
    with MdfLog(path, open_mdf(path)) as log:
        tracemalloc.start()
        for piece in log.pieces(list(log.channels)):
            count += sum(len(series.time) for series in piece.values())
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert count == channels * readings
    assert peak < 3 * path.stat().st_size  # 5 times with views

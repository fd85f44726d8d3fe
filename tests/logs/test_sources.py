# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Time, unit, group, run and bus of the channels of a log."""

from datetime import datetime, timedelta
from itertools import zip_longest

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt

from . import recordings

pytest.importorskip("asammdf")
pytest.importorskip("nptdms")
pytest.importorskip("can")
pytest.importorskip("cantools")

NAMES = ("EngineSpeed", "EngineTorque", "OutputSpeed", "OutputTorque", "PumpStroke")
UNITS = dict(zip(NAMES, ("rpm", "N m", "rpm", "N m", "%"), strict=True))
START = np.datetime64("2026-03-02T08:00:00", "us")


@pytest.fixture(scope="module")
def recorded():
    time, columns = recordings.recorded(noise=0.0005)
    return time, dict(zip(NAMES, columns.values(), strict=True))


@pytest.fixture(scope="module")
def expected(recorded, tmp_path_factory):
    path = tmp_path_factory.mktemp("expected") / "plain.mf4"
    recordings.write_mdf(path, *recorded, UNITS)
    return imported(path).efficiency


def imported(path, *options):
    out = path.with_suffix(".csv")
    run("import", path, "--out", out, "--yes", *options)
    return hmcvt.read_bench(out)


def refused(path, *options):
    """Import a log that leaves something open."""
    done = run("import", path, "--out", path.with_suffix(".csv"), "--yes", *options)
    assert done.code == 2, done.out
    return done


def write_tdms(path, columns, starts, group="bench"):
    """Write channels, each with its start; None writes no start."""
    from nptdms import ChannelObject, TdmsWriter

    objects = []
    for name, values in columns.items():
        properties = {"unit_string": UNITS[name], "wf_increment": 1.0 / recordings.RATE}
        if starts.get(name) is not None:
            properties["wf_start_time"] = starts[name]
        objects.append(ChannelObject(group, name, values, properties=properties))
    with TdmsWriter(path, mode="a" if path.exists() else "w") as writer:
        writer.write_segment(objects)


def seconds(count):
    return np.timedelta64(int(count * 1e6), "us")


def test_start_times_of_tdms_channels(tmp_path, recorded, expected):
    _, columns = recorded
    late = dict(columns)
    starts = dict.fromkeys(columns, START)
    skipped = int(11.0 * recordings.RATE)
    for name in ("OutputSpeed", "OutputTorque"):
        late[name] = columns[name][skipped:]
        starts[name] = START + seconds(11.0)
    write_tdms(tmp_path / "late.tdms", late, starts)
    efficiency = imported(tmp_path / "late.tdms").efficiency
    assert len(efficiency) == len(expected) - 1
    np.testing.assert_allclose(efficiency[-3:], expected[-3:], rtol=1e-4)


def test_some_channels_without_a_start_time_are_asked(tmp_path, recorded):
    _, columns = recorded
    starts = dict.fromkeys(columns, START) | {"OutputTorque": None}
    write_tdms(tmp_path / "mixed.tdms", columns, starts)
    done = refused(tmp_path / "mixed.tdms")
    assert "'OutputTorque' none" in done.err
    assert "wf_start_time" in done.err


def test_runs_are_asked_and_chosen(tmp_path, recorded, expected):
    _, columns = recorded
    path = tmp_path / "runs.tdms"
    write_tdms(path, columns, dict.fromkeys(columns, START), "Run1")
    write_tdms(path, columns, dict.fromkeys(columns, START + seconds(3600.0)), "Run2")
    done = refused(path)
    assert "--group Run1 or --group Run2" in done.err
    samples = imported(path, "--group", "Run2")
    np.testing.assert_allclose(samples.efficiency, expected, rtol=1e-6)
    done = refused(path, "--group", "Run3")
    assert "group 'Run3' is missing; there is Run1, Run2" in done.err


def test_groups_of_mdf_are_asked(tmp_path, recorded, expected):
    import asammdf

    time, columns = recorded
    mdf = asammdf.MDF(version="4.10")
    for run_name, start in (("first", 0.0), ("second", 100.0)):
        signals = []
        for name, values in columns.items():
            signals.append(
                asammdf.Signal(values, time + start, name=name, unit=UNITS[name])
            )
        mdf.append(signals, acq_name=run_name)
    path = tmp_path / "runs.mf4"
    mdf.save(path, overwrite=True)
    mdf.close()
    done = refused(path)
    assert "--group first or --group second" in done.err
    samples = imported(path, "--group", "second")
    np.testing.assert_allclose(samples.efficiency, expected, rtol=1e-6)


def test_a_device_behind_a_name(tmp_path, recorded, expected):
    time, columns = recorded
    devices = {f"{name}\\ETKC:1": values for name, values in columns.items()}
    units = {f"{name}\\ETKC:1": unit for name, unit in UNITS.items()}
    recordings.write_mdf(tmp_path / "inca.mf4", time, devices, units)
    samples = imported(tmp_path / "inca.mf4")
    np.testing.assert_allclose(samples.efficiency, expected, rtol=1e-6)


def test_two_devices_are_asked(tmp_path, recorded):
    time, columns = recorded
    both = {f"{name}\\ETKC:1": values for name, values in columns.items()}
    both["EngineTorque\\CAN:2"] = 0.97 * columns["EngineTorque"]
    units = {name: UNITS[name.partition("\\")[0]] for name in both}
    recordings.write_mdf(tmp_path / "two.mf4", time, both, units)
    done = refused(tmp_path / "two.mf4")
    assert "both name engine torque" in done.err


@pytest.mark.parametrize("unit", ["1/s", "Hz", "rps"])
def test_a_unit_that_may_count_turns_is_asked(tmp_path, recorded, unit):
    time, columns = recorded
    turns = {**columns, "EngineSpeed": columns["EngineSpeed"] / 60.0}
    path = tmp_path / "turns.mf4"
    recordings.write_mdf(path, time, turns, {**UNITS, "EngineSpeed": unit})
    done = refused(path)
    assert "may count radians or turns" in done.err
    assert "--engine-speed EngineSpeed:rad/s" in done.err


def test_units_that_are_missing_are_asked(tmp_path, recorded):
    time, columns = recorded
    units = {**UNITS, "EngineTorque": "", "OutputTorque": ""}
    recordings.write_mdf(tmp_path / "bare.mf4", time, columns, units)
    done = refused(tmp_path / "bare.mf4")
    assert "channel 'EngineTorque' states no unit" in done.err


def printed(messages, stamps, bus="can0"):
    """Frames as candump prints them."""
    lines = []
    for message, stamp in zip(messages, stamps, strict=True):
        data = " ".join(f"{byte:02X}" for byte in message.data)
        lines.append(
            f"{stamp}  {bus}  {message.arbitration_id:08X}   [{len(message.data)}]  {data}\n"
        )
    return "".join(lines)


@pytest.fixture(scope="module")
def messages(recorded):
    time, columns = recorded
    short = ("n_engine", "M_engine", "n_output", "M_output", "PumpStroke")
    return list(
        recordings.frames(time, dict(zip(short, columns.values(), strict=True)))
    )


@pytest.fixture
def dbc(tmp_path):
    recordings.write_dbc(tmp_path / "bench.dbc")
    return tmp_path / "bench.dbc"


def log_samples(tmp_path, messages, dbc):
    """Samples of the log of candump -l."""
    import can

    with can.Logger(str(tmp_path / "plain.log")) as writer:
        for message in messages:
            writer(message)
    return imported(tmp_path / "plain.log", "--dbc", dbc)


@pytest.mark.parametrize("form", ["absolute", "zero", "delta"])
def test_printed_candump(tmp_path, messages, dbc, form):
    times = np.array([message.timestamp for message in messages])
    # Frames of one row of the recording follow each other, as on a bus.
    times = times + np.tile([0.0, 0.001], len(times) // 2)
    for message, time in zip(messages, times, strict=True):
        message.timestamp = float(time)
    stamps = times
    if form == "zero":
        stamps = times - times[0]
    elif form == "delta":
        stamps = np.diff(np.round(times, 6), prepend=round(float(times[0]), 6))
    texts = [f" ({stamp:017.6f})" for stamp in stamps]
    path = tmp_path / "printed.log"
    path.write_text(printed(messages, texts))
    samples = imported(path, "--dbc", dbc)
    reference = log_samples(tmp_path, messages, dbc)
    np.testing.assert_allclose(samples.efficiency, reference.efficiency, rtol=1e-5)


def test_printed_candump_without_stamps(tmp_path, messages, dbc):
    path = tmp_path / "bare.log"
    path.write_text(printed(messages, [""] * len(messages)))
    done = refused(path, "--dbc", dbc)
    assert "no time stamp: record with candump -l" in done.err


def test_asc_with_relative_stamps(tmp_path, messages, dbc):
    lines = ["date Mon Mar 2 08:00:00.000 2026\n", "base hex  timestamps relative\n"]
    before = messages[0].timestamp
    for message in messages:
        data = " ".join(f"{byte:02X}" for byte in message.data)
        step = message.timestamp - before
        before = message.timestamp
        lines.append(f"   {step:.6f} 1  {message.arbitration_id:X}x Rx d 8 {data}\n")
    path = tmp_path / "relative.asc"
    path.write_text("".join(lines))
    samples = imported(path, "--dbc", dbc)
    reference = log_samples(tmp_path, messages, dbc)
    np.testing.assert_allclose(samples.efficiency, reference.efficiency, rtol=1e-4)


def test_two_buses_are_asked_and_chosen(tmp_path, messages, dbc):
    lines = []
    for message in messages:
        data = message.data.hex().upper()
        other = bytearray(message.data)
        other[4] ^= 0x40  # another torque on the other bus
        for bus, text in (("can0", data), ("can1", other.hex().upper())):
            stamp = f"({message.timestamp:.6f})"
            lines.append(f"{stamp} {bus} {message.arbitration_id:08X}#{text}\n")
    path = tmp_path / "two.log"
    path.write_text("".join(lines))
    done = refused(path, "--dbc", dbc)
    assert "--group can0 or --group can1" in done.err
    samples = imported(path, "--dbc", dbc, "--group", "can0")
    reference = log_samples(tmp_path, messages, dbc)
    np.testing.assert_array_equal(samples.efficiency, reference.efficiency)


def asc_text(messages, zero):
    """Frames as CANoe writes them, whose times count from a trigger."""
    lines = ["date Mon Mar 2 08:00:00.000 2026\n", "base hex  timestamps absolute\n"]
    first = messages[0].timestamp
    for message in messages:
        data = " ".join(f"{byte:02X}" for byte in message.data)
        stamp = message.timestamp - first - zero
        lines.append(f"   {stamp:.6f} 1  {message.arbitration_id:X}x Rx d 8 {data}\n")
    return "".join(lines)


def test_frames_before_the_trigger_of_an_asc_file(tmp_path, messages, dbc):
    path = tmp_path / "trigger.asc"
    path.write_text(asc_text(messages, 12.5))
    done = run("import", path, "--dbc", dbc, "--out", tmp_path / "o.csv", "--yes")
    assert "stamps begin below zero: times count from -13 s" in done.out
    samples = hmcvt.read_bench(tmp_path / "o.csv")
    reference = log_samples(tmp_path, messages, dbc)
    np.testing.assert_allclose(samples.efficiency, reference.efficiency, rtol=1e-6)


def test_stamps_of_mdf_below_zero(tmp_path, recorded, expected):
    time, columns = recorded
    path = tmp_path / "trigger.mf4"
    recordings.write_mdf(path, time - 3600.0, columns, UNITS)
    samples = imported(path)
    np.testing.assert_allclose(samples.efficiency, expected, rtol=1e-6)
    assert samples.stamp.min() >= 0.0


@pytest.mark.parametrize("error", [8e9, -8e9])
def test_one_wrong_stamp_costs_one_reading(tmp_path, recorded, expected, error):
    time, columns = recorded
    wrong = time.copy()
    wrong[len(time) // 3] += error
    path = tmp_path / "wrong.mf4"
    recordings.write_mdf(path, wrong, columns, UNITS)
    samples = imported(path)
    np.testing.assert_allclose(samples.efficiency, expected, rtol=1e-4)
    assert samples.stamp.max() < 1e4


def steps_of(stroke):
    """Rows at which a stroke changes."""
    return np.flatnonzero(np.append(True, np.diff(stroke) != 0.0))


TESTS = 4
LONG = 40.0


@pytest.fixture(scope="module")
def long_tests():
    """Four tests of 40 s, with one efficiency each, and a stroke that is sent on change."""
    time = np.arange(0.0, TESTS * LONG, 0.1)
    test = (time // LONG).astype(int)
    noise = 1.0 + 3e-4 * np.random.default_rng(3).standard_normal((4, len(time)))
    stroke = np.array([20.0, -60.0, 80.0, 50.0])[test]
    speed = np.array([1200.0, 1500.0, 1800.0, 1400.0])[test]
    torque = np.array([300.0, 350.0, 250.0, 400.0])[test]
    ratio = 1.0 + 0.005 * stroke
    columns = {
        "EngineSpeed": speed * noise[0],
        "EngineTorque": torque * noise[1],
        "OutputSpeed": ratio * speed * noise[2],
        "OutputTorque": 0.8 * torque / ratio * noise[3],
        "PumpStroke": stroke,
    }
    return time, columns


def require_long_tests(samples):
    assert len(samples) == TESTS
    np.testing.assert_allclose(
        samples.displacement_ratio, [0.2, -0.6, 0.8, 0.5], atol=1e-9
    )
    np.testing.assert_allclose(samples.efficiency, 0.8, rtol=1e-3)


def test_a_set_point_in_a_group_of_its_own_holds(tmp_path, long_tests):
    import asammdf

    time, columns = long_tests
    changes = steps_of(columns["PumpStroke"])
    mdf = asammdf.MDF(version="4.10")
    fast = []
    for name, values in columns.items():
        if name != "PumpStroke":
            fast.append(asammdf.Signal(values, time, name=name, unit=UNITS[name]))
    mdf.append(fast)
    stroke = columns["PumpStroke"][changes]
    mdf.append(asammdf.Signal(stroke, time[changes], name="PumpStroke", unit="%"))
    path = tmp_path / "change.mf4"
    mdf.save(path)
    mdf.close()
    require_long_tests(imported(path))


def write_table(path, time, columns, changes):
    """Write a table in which the stroke stands only where it changes."""
    lines = ["time [s];" + ";".join(f"{name} [{UNITS[name]}]" for name in columns)]
    for row, now in enumerate(time):
        cells = [f"{values[row]:.6g}" for values in columns.values()]
        if row not in changes:
            cells[-1] = ""
        lines.append(";".join([f"{now:.1f}", *cells]))
    path.write_text("\n".join(lines) + "\n")


def test_a_set_point_of_a_table_holds(tmp_path, long_tests):
    time, columns = long_tests
    path = tmp_path / "change.csv"
    write_table(path, time, columns, steps_of(columns["PumpStroke"]))
    out = tmp_path / "samples.csv"
    run("import", path, "--out", out, "--yes")
    require_long_tests(hmcvt.read_bench(out))


def test_a_set_point_says_nothing_of_the_time_before_it(tmp_path, long_tests):
    time, columns = long_tests
    path = tmp_path / "late.csv"
    write_table(path, time, columns, steps_of(columns["PumpStroke"])[1:])
    out = tmp_path / "samples.csv"
    run("import", path, "--out", out, "--yes")
    samples = hmcvt.read_bench(out)
    np.testing.assert_allclose(samples.displacement_ratio, [-0.6, 0.8, 0.5], atol=1e-9)


def two_clocks(
    path,
    long_tests,
    clocks,
    order=("PumpStroke", "Engine", "Output"),
    every=1,
    written="{:.1f}".format,
):
    """Write a table whose output task began 9 s after the input task, each with its clock.

    Args:
        path: of the table.
        long_tests: times and columns.
        clocks: names of the clocks by task.
        order: of the tasks.
        every: how many times slower the output task reads.
        written: a time as text.
    """
    time, columns = long_tests
    late = 90
    rows = len(time) - late
    of_input = slice(0, rows)
    of_output = slice(late, late + rows, every)
    header = []
    cells = []
    for task in order:
        part = of_output if task == "Output" else of_input
        if task in clocks:
            header.append(clocks[task])
            cells.append([written(now) for now in time[part]])
        for name, values in columns.items():
            if name.startswith(task):
                header.append(f"{name} [{UNITS[name]}]")
                cells.append([f"{value:.6g}" for value in values[part]])
    lines = [";".join(header)]
    lines += [";".join(row) for row in zip_longest(*cells, fillvalue="")]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    "clocks",
    [
        {"PumpStroke": "time_in [s]", "Output": "time_out [s]"},
        {"PumpStroke": "Time [s]", "Output": "Time [s]"},
        {"PumpStroke": "t", "Output": "t_output [s]"},
    ],
)
def test_tasks_of_a_table_with_a_clock_each(tmp_path, long_tests, clocks):
    path = tmp_path / "clocks.csv"
    two_clocks(path, long_tests, clocks)
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
    assert "clocks differ" in done.out, done.err
    require_long_tests(hmcvt.read_bench(tmp_path / "o.csv"))


@pytest.mark.parametrize("every", [3, 5])
def test_a_task_that_reads_slower_has_fewer_rows(tmp_path, long_tests, every):
    path = tmp_path / "clocks.csv"
    clocks = {"PumpStroke": "t_stroke [s]", "Engine": "t_in [s]", "Output": "t_out [s]"}
    two_clocks(path, long_tests, clocks, every=every)
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
    assert "clocks differ" in done.out, done.err
    require_long_tests(hmcvt.read_bench(tmp_path / "o.csv"))


def test_clocks_that_are_dates(tmp_path, long_tests):
    path = tmp_path / "clocks.csv"
    clocks = {"PumpStroke": "timestamp_in", "Output": "timestamp_out"}

    def date(now):
        return (datetime(2026, 11, 28, 9) + timedelta(seconds=now)).isoformat(
            timespec="milliseconds"
        )

    two_clocks(path, long_tests, clocks, every=3, written=date)
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
    assert "clocks differ" in done.out, done.err
    require_long_tests(hmcvt.read_bench(tmp_path / "o.csv"))


def test_dates_in_whole_seconds_go_on_as_the_seconds_of_the_recording(
    tmp_path, long_tests
):
    path = tmp_path / "clocks.csv"
    time, columns = long_tests
    names = list(columns)
    head = ["time [s]", *(f"{name} [{UNITS[name]}]" for name in names)]
    head.insert(3, "timestamp")
    lines = [";".join(head)]
    for row, now in enumerate(time):
        cells = [f"{now:.1f}", *(f"{columns[name][row]:.6g}" for name in names)]
        cells.insert(3, f"2026-11-28T09:{int(now) // 60:02d}:{int(now) % 60:02d}")
        lines.append(";".join(cells))
    path.write_text("\n".join(lines) + "\n")
    options = ("--stamp", "time [s]:s", "--yes")
    done = run("import", path, *options, "--out", tmp_path / "o.csv")
    assert done.code == 0, done.err
    require_long_tests(hmcvt.read_bench(tmp_path / "o.csv"))


def test_a_clock_of_dates_and_one_of_seconds_that_differ_are_asked(
    tmp_path, long_tests
):
    path = tmp_path / "clocks.csv"
    clocks = {"PumpStroke": "time [s]", "Output": "timestamp_out"}
    kept = []

    def mixed(now):
        kept.append(now)
        if len(kept) <= len(long_tests[0]) - 90:
            return f"{now:.1f}"
        return (datetime(2026, 11, 28, 9) + timedelta(seconds=2.0 * now)).isoformat(
            timespec="milliseconds"
        )

    two_clocks(path, long_tests, clocks, written=mixed)
    done = run("import", path, "--stamp", "time [s]", "--out", tmp_path / "o.csv")
    assert done.code == 2
    assert "keep one of them" in done.err


def test_clocks_of_a_table_that_belong_to_no_column_in_front(tmp_path, long_tests):
    path = tmp_path / "clocks.csv"
    order = ("EngineTorque", "PumpStroke", "EngineSpeed", "Output")
    clocks = {"PumpStroke": "time [s]", "Output": "time_out [s]"}
    two_clocks(path, long_tests, clocks, order)
    done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
    assert done.code == 2
    assert "'EngineTorque [N m]' stands in front of them" in done.err

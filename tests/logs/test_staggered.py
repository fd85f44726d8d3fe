# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One recording whose tasks begin at other times and read in turns, in six formats.

All stamps are multiples of 1/64 s and all values multiples of their step on the bus, so that every
format holds the same numbers.
"""

from itertools import zip_longest

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt

asammdf = pytest.importorskip("asammdf")
can = pytest.importorskip("can")
cantools = pytest.importorskip("cantools")
nptdms = pytest.importorskip("nptdms")

EPOCH = 1_700_000_000
STEP = 1.0 / 32.0
SECONDS = 20
BEGIN = {"INPUT": 0.0, "OUTPUT": 9.0 + 1.0 / 64.0, "UNIT": 2.0}
"""First stamp of each task [s]; the output reads between two readings of the input."""
SIGNALS = {
    "INPUT": {"EngineSpeed": ("rpm", 0.05), "EngineTorque": ("Nm", 0.05)},
    "OUTPUT": {"OutputSpeed": ("rpm", 0.05), "OutputTorque": ("Nm", 0.05)},
    "UNIT": {"PumpStroke": ("%", 0.01)},
}
"""Unit and step of each signal by the task that reads it."""
IDENTIFIERS = {"INPUT": 0x18FF0101, "OUTPUT": 0x18FF0102, "UNIT": 0x18FF0103}
"""One parameter group that three addresses send, each with other signals."""
TESTS = ((-60.0, 1500.0, 250.0), (20.0, 1800.0, 320.0), (70.0, 1200.0, 280.0))
"""Stroke [%], engine speed [r/min] and engine torque [N m]."""
COLUMNS = ("displacement_ratio", "engine_speed", "load_torque", "efficiency")


def dbc():
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: BENCH", ""]
    for task, signals in SIGNALS.items():
        lines.append(f"BO_ {IDENTIFIERS[task] + 0x80000000} {task}: 8 BENCH")
        for number, (name, (unit, step)) in enumerate(signals.items()):
            sign = "-" if name == "PumpStroke" else "+"
            place = f"{16 * number}|16@1{sign}"
            lines.append(f' SG_ {name} : {place} ({step},0) [0|0] "{unit}" BENCH')
        lines.append("")
    return "\n".join(lines) + "\n"


def recording():
    """Return stamps by task, and whole steps by signal."""
    rng = np.random.default_rng(11)
    stamps = {}
    steps = {}
    for task, signals in SIGNALS.items():
        count = int((SECONDS * len(TESTS) - BEGIN[task]) / STEP)
        stamps[task] = BEGIN[task] + STEP * np.arange(count)
        test = np.minimum(stamps[task] / SECONDS, len(TESTS) - 1).astype(int)
        stroke, speed, torque = np.array(TESTS)[test].T
        ratio = 1.0 + 0.005 * stroke
        values = {
            "PumpStroke": stroke,
            "EngineSpeed": speed,
            "EngineTorque": torque,
            "OutputSpeed": ratio * speed,
            "OutputTorque": 0.8 * torque / ratio,
        }
        for name, (_, step) in signals.items():
            noise = rng.integers(-3, 4, count) * (name != "PumpStroke")
            steps[name] = np.round(values[name] / step).astype(int) + noise
    return stamps, steps


def channels(steps):
    """Return the values of each signal, computed as a reader of frames does."""
    values = {}
    for signals in SIGNALS.values():
        for name, (_, step) in signals.items():
            values[name] = step * steps[name].astype(float) + 0.0
    return values


def write_csv(path, stamps, steps):
    values = channels(steps)
    columns = []
    for task, signals in SIGNALS.items():
        columns.append([f"time {task} [s]", *map(repr, stamps[task].tolist())])
        for name, (unit, _) in signals.items():
            columns.append([f"{name} [{unit}]", *map(repr, values[name].tolist())])
    rows = zip_longest(*columns, fillvalue="")
    path.write_text("\n".join(map(",".join, rows)) + "\n")


def write_mf4(path, stamps, steps):
    values = channels(steps)
    mdf = asammdf.MDF(version="4.10")
    for task, signals in SIGNALS.items():
        group = []
        for name, (unit, _) in signals.items():
            group.append(
                asammdf.Signal(values[name], stamps[task], name=name, unit=unit)
            )
        mdf.append(group, acq_name=task)
    mdf.save(path, overwrite=True)
    mdf.close()


def write_tdms(path, stamps, steps):
    values = channels(steps)
    start = np.datetime64("2026-03-02T08:00:00", "us")
    objects = []
    for task, signals in SIGNALS.items():
        begin = start + np.timedelta64(round(1e6 * BEGIN[task]), "us")
        for name, (unit, _) in signals.items():
            properties = {
                "unit_string": unit,
                "wf_increment": STEP,
                "wf_start_time": begin,
            }
            objects.append(
                nptdms.ChannelObject("bench", name, values[name], properties=properties)
            )
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(objects)


def write_trace(path, stamps, steps):
    database = cantools.database.load_string(dbc(), "dbc")
    frames = []
    for task, signals in SIGNALS.items():
        message = database.get_message_by_name(task)
        for row, now in enumerate(stamps[task].tolist()):
            raw = {name: int(steps[name][row]) for name in signals}
            frames.append(
                can.Message(
                    timestamp=EPOCH + now,
                    arbitration_id=IDENTIFIERS[task],
                    is_extended_id=True,
                    data=message.encode(raw, scaling=False, padding=True),
                )
            )
    with can.Logger(str(path)) as writer:
        for frame in sorted(frames, key=lambda frame: frame.timestamp):
            writer(frame)


WRITERS = {
    "csv": write_csv,
    "mf4": write_mf4,
    "tdms": write_tdms,
    "log": write_trace,
    "blf": write_trace,
    "asc": write_trace,
}


def imported(folder, suffix):
    path = folder / f"bench.{suffix}"
    WRITERS[suffix](path, *recording())
    options = []
    if WRITERS[suffix] is write_trace:
        (folder / "bench.dbc").write_text(dbc())
        options = ["--dbc", folder / "bench.dbc"]
    out = folder / f"{suffix}.csv"
    done = run("import", path, "--out", out, "--yes", *options)
    assert done.code == 0, done.err
    return hmcvt.read_bench(out)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return imported(tmp_path_factory.mktemp("reference"), "mf4")


def test_the_tests_of_the_recording(reference):
    np.testing.assert_allclose(reference.displacement_ratio, [-0.6, 0.2, 0.7])
    np.testing.assert_allclose(reference.efficiency, 0.8, rtol=1e-3)


@pytest.mark.parametrize("suffix", [name for name in WRITERS if name != "mf4"])
def test_all_formats_give_the_same_tests_to_the_last_digit(tmp_path, reference, suffix):
    samples = imported(tmp_path, suffix)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(samples, name), getattr(reference, name))


def test_a_second_machine_in_the_parameter_group(tmp_path, reference):
    """Its stroke has the same place in its frames and is sent twice as often."""
    stamps, steps = recording()
    write_trace(tmp_path / "bench.log", stamps, steps)
    (tmp_path / "bench.dbc").write_text(
        dbc()
        + "BO_ 2566848772 OTHER: 8 BENCH\n"
        + ' SG_ PumpStroke : 0|16@1- (0.01,0) [0|0] "%" BENCH\n'
    )
    lines = (tmp_path / "bench.log").read_text().splitlines()
    frames = []
    for line in lines:
        frames.append(line)
        if "18FF0103#" in line:
            frames += 2 * [line.replace("18FF0103#", "18FF0104#0A00")]
    (tmp_path / "bench.log").write_text("\n".join(frames) + "\n")
    done = run(
        *("import", tmp_path / "bench.log", "--dbc", tmp_path / "bench.dbc"),
        *("--displacement-ratio", "UNIT.PumpStroke:%"),
        *("--out", tmp_path / "o.csv", "--yes"),
    )
    assert done.code == 0, done.err
    samples = hmcvt.read_bench(tmp_path / "o.csv")
    np.testing.assert_array_equal(
        samples.displacement_ratio, reference.displacement_ratio
    )

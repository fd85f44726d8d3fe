# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Write what a bench recorded, as loggers write it.

The files are written by the libraries that own their formats, or as the text that can-utils, Vector
tools and spreadsheets write.
"""

from __future__ import annotations

from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from .truth import (
    FOREIGN,
    INPUT,
    OUTPUT,
    History,
    Readings,
    Recording,
    random_history,
)

UNITS = {
    "EngineSpeed": (("rpm", 1.0), ("1/min", 1.0), ("rad/s", np.pi / 30.0)),
    "EngineTorque": (("Nm", 1.0), ("kNm", 1e-3), ("N m", 1.0)),
    "OutputSpeed": (("rpm", 1.0), ("rad/s", np.pi / 30.0)),
    "OutputTorque": (("Nm", 1.0), ("daN m", 0.1)),
    "PumpStroke": (("%", 1.0), ("\u2030", 10.0)),
}
"""Units of each channel, and their number in r/min, N m and percent."""
_FOOT_POUND = 1.3558179483
_START = np.datetime64("2026-03-02T08:00:00", "us")
_EPOCH = 1_772_438_400.0
_WRONG = 8e9
"""Amount by which one stamp is wrong [s]: 2,222,222 h."""
_RUN = 1000.0
"""Distance of two runs of one file [s]."""
_DBC = """VERSION ""

NS_ :

BS_:

BU_: BENCH

BO_ {numbers[0]} INPUT: 8 BENCH
 SG_ EngineSpeed : 0|32@1+ (0.001,0) [0|4000] "rpm" BENCH
 SG_ EngineTorque : 32|32@1- (0.001,0) [-2000|2000] "{torque}" BENCH

BO_ {numbers[1]} OUTPUT: 8 BENCH
 SG_ OutputSpeed : 0|32@1- (0.001,0) [-4000|4000] "rpm" BENCH
 SG_ OutputTorque : 32|32@1- (0.001,0) [-4000|4000] "{torque}" BENCH

BO_ {numbers[2]} UNIT: 8 BENCH
 SG_ PumpStroke : 0|32@1- (0.001,0) [-110|110] "%" BENCH

BO_ {numbers[3]} OTHERS: 8 BENCH
 SG_ CoolantTemperature : 0|16@1- (0.01,0) [-40|200] "degC" BENCH
 SG_ EngineSpeedSetpoint : 16|16@1+ (0.125,0) [0|4000] "rpm" BENCH
"""
_STANDARD = (0x100, 0x101, 0x102, 0x103)
_ONE_GROUP = (0x18FF5010, 0x18FF5011, 0x18FF5017, 0x18FF5020)
"""Identifiers of one parameter group of J1939 that four addresses send."""
_LARGEST_STANDARD = 0x7FF
_EXTENDED = 0x80000000
"""Bit by which a DBC marks an identifier of 29 bits."""


def random_recording(rng: np.random.Generator, folder: Path) -> Recording:
    """Write a random recording.

    Args:
        rng: of all choices.
        folder: for the file and its DBC.
    """
    history = random_history(rng)
    kind = str(rng.choice(list(_WRITERS)))
    return _WRITERS[kind](rng, folder, kind, history)


def _in_units(
    rng: np.random.Generator, history: History, bare: bool
) -> tuple[dict[str, Readings], dict[str, str]]:
    """Return the readings in random units, and the units.

    Args:
        rng: of the units.
        history: in r/min, N m and percent.
        bare: whether the torques are in lb ft and the file does not state it.
    """
    written = {}
    units = {}
    for name, readings in history.readings.items():
        if name in FOREIGN:
            units[name] = FOREIGN[name][0]
            written[name] = readings
            continue
        choice = UNITS[name][int(rng.integers(len(UNITS[name])))]
        units[name], size = choice
        if bare and name.endswith("Torque"):
            units[name] = ""
            size = 1.0 / _FOOT_POUND
        written[name] = readings._replace(values=size * readings.values)
    return written, units


def _with_wrong_stamp(rng: np.random.Generator, time: Any) -> Any:
    """Return times of which one is wrong by far."""
    wrong = time.copy()
    wrong[int(rng.integers(5, len(time) - 5))] += float(rng.choice([_WRONG, -_WRONG]))
    return wrong


def _mf4(
    rng: np.random.Generator, folder: Path, kind: str, history: History
) -> Recording:
    import asammdf

    path = folder / "recording.mf4"
    bare = bool(rng.random() < 0.15)
    wrong_stamp = bool(rng.random() < 0.15)
    suffix = str(rng.choice(["", "\\ETKC:1"]))
    runs = int(rng.choice([1, 1, 1, 2]))
    zero = float(rng.choice([0.0, 5.0, 3600.0]))
    written, units = _in_units(rng, history, bare)
    mdf = asammdf.MDF(version="4.10")
    for run in range(runs):
        groups: dict[str, list[Any]] = {"input": [], "output": [], "stroke": []}
        others = history.features["foreign"]
        members = {"input": (*INPUT, *others), "output": OUTPUT}
        members["stroke"] = ("PumpStroke",)
        for group, names in members.items():
            stamps = written[names[0]].time - zero + _RUN * run
            if wrong_stamp and group == "input":
                stamps = _with_wrong_stamp(rng, stamps)
            for name in names:
                signal = asammdf.Signal(
                    written[name].values,
                    stamps,
                    name=f"{name}{suffix}",
                    unit=units[name],
                )
                groups[group].append(signal)
            mdf.append(groups[group], acq_name=f"{group} {run}")
    mdf.save(path, overwrite=True)
    mdf.close()
    features = {"format": kind, "suffix": suffix, "runs": runs, "bare": bare}
    features |= {"wrong_stamp": wrong_stamp, "zero": zero}
    return Recording(path, (), history, bare or runs > 1, features)


def _tdms(
    rng: np.random.Generator, folder: Path, kind: str, history: History
) -> Recording:
    from nptdms import ChannelObject, TdmsWriter

    path = folder / "recording.tdms"
    bare = bool(rng.random() < 0.15)
    on_change = history.features["on_change"]
    # A waveform has one step; what is sent on change needs a channel of times.
    form = str(rng.choice(["dates", "seconds"]))
    if not on_change:
        form = str(rng.choice(["start", "offset", "mixed", "dates", "seconds"]))
    runs = int(rng.choice([1, 1, 1, 2]))
    written, units = _in_units(rng, history, bare)
    objects = []
    for run in range(runs):
        for name, readings in written.items():
            begin = readings.time[0] + history.features["early"] + _RUN * run
            properties: dict[str, Any] = {"unit_string": units[name]}
            group = f"Run{run}"
            is_dated = form == "start" or (form == "mixed" and name not in OUTPUT)
            if form in ("start", "offset", "mixed"):
                properties["wf_increment"] = float(readings.time[1] - readings.time[0])
            if is_dated:
                properties["wf_start_time"] = _START + _micro(begin)
            elif form in ("offset", "mixed"):
                properties["wf_start_offset"] = begin
            else:
                group = _group_of(name, run)
            objects.append(
                ChannelObject(group, name, readings.values, properties=properties)
            )
        if form in ("dates", "seconds"):
            for name in ("EngineSpeed", "OutputSpeed", "PumpStroke"):
                since = written[name].time + history.features["early"] + _RUN * run
                times = since
                if form == "dates":
                    times = _START + (1e6 * since).astype("timedelta64[us]")
                group = _group_of(name, run)
                objects.append(
                    ChannelObject(group, "Time", times, {"unit_string": "s"})
                )
    with TdmsWriter(path) as writer:
        writer.write_segment(objects)
    features = {"format": kind, "form": form, "runs": runs, "bare": bare}
    must_ask = runs > 1 or form == "mixed" or bare
    return Recording(path, (), history, must_ask, features)


def _micro(seconds: float) -> np.timedelta64:
    return np.timedelta64(round(1e6 * seconds), "us")


def _group_of(name: str, run: int) -> str:
    """Return the group of a channel whose times stand in a channel of their own."""
    if name in OUTPUT:
        return f"Output{run}"
    if name == "PumpStroke":
        return f"Stroke{run}"
    return f"Input{run}"


def _csv(
    rng: np.random.Generator, folder: Path, kind: str, history: History
) -> Recording:
    """Write all channels on the clock of the engine; a cell is empty where there is no reading."""
    path = folder / "recording.csv"
    if rng.random() < 0.25:
        return _tasks(rng, path, history)
    bare = bool(rng.random() < 0.15)
    wrong_stamp = bool(rng.random() < 0.15)
    zero = float(rng.choice([0.0, 5.0]))
    written, units = _in_units(rng, history, bare)
    clock = written["EngineSpeed"].time
    stamps = clock - zero
    if wrong_stamp:
        stamps = _with_wrong_stamp(rng, stamps)
    header = ["time [s]"]
    columns = [[f"{stamp:.4f}" for stamp in stamps]]
    half = 0.5 / history.features["rate"]
    for name, readings in written.items():
        header.append(f"{name} [{units[name]}]" if units[name] else name)
        cells = [""] * len(clock)
        rows = np.searchsorted(clock, readings.time - half)
        for row, value in zip(rows.tolist(), readings.values.tolist(), strict=True):
            if row < len(clock):
                cells[row] = f"{value:.9g}"
        columns.append(cells)
    lines = [";".join(header)]
    lines += [";".join(row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    features = {"format": kind, "bare": bare, "zero": zero, "wrong_stamp": wrong_stamp}
    return Recording(path, (), history, bare, features)


def _tasks(rng: np.random.Generator, path: Path, history: History) -> Recording:
    """Write each task with its clock in front of it, row by row as they came."""
    written, units = _in_units(rng, history, False)
    clock = str(rng.choice(["time {} [s]", "t_{} [s]", "Time [s]"]))
    tasks = {"in": INPUT, "stroke": ("PumpStroke",), "out": OUTPUT}
    columns = []
    for task, names in tasks.items():
        stamps = written[names[0]].time + history.features["early"]
        columns.append([clock.format(task), *(f"{stamp:.4f}" for stamp in stamps)])
        for name in names:
            values = written[name].values.tolist()
            columns.append(
                [f"{name} [{units[name]}]", *(f"{value:.9g}" for value in values)]
            )
    rows = zip_longest(*columns, fillvalue="")
    path.write_text("\n".join(map(";".join, rows)) + "\n", encoding="utf-8")
    features = {"format": "csv", "clock": clock}
    return Recording(path, (), history, False, features)


def _can(
    rng: np.random.Generator, folder: Path, kind: str, history: History
) -> Recording:
    suffix = "log" if kind in ("printed", "delta") else kind
    path = folder / f"recording.{suffix}"
    dbc = folder / "recording.dbc"
    bare = bool(rng.random() < 0.15)
    one_group = bool(rng.random() < 0.4)
    identifiers = _ONE_GROUP if one_group else _STANDARD
    numbers = [number + _EXTENDED * one_group for number in identifiers]
    dbc.write_text(_DBC.format(torque="" if bare else "Nm", numbers=numbers))
    buses = int(rng.choice([1, 1, 1, 2]))
    relative = bool(rng.random() < 0.5)
    # A difference to the frame before cannot hold a wrong stamp of its own.
    wrong_stamp = bool(rng.random() < 0.15) and kind == "log"
    frames = _frames(history, buses, identifiers)
    if wrong_stamp:
        row = int(rng.integers(20, len(frames) - 20))
        frames[row] = (frames[row][0] + _WRONG, *frames[row][1:])
    if kind in ("blf", "trc"):
        _by_python_can(path, frames)
    else:
        path.write_text(_text(rng, kind, frames, relative))
    features = {"format": kind, "buses": buses, "relative": relative, "bare": bare}
    features |= {"wrong_stamp": wrong_stamp, "one_group": one_group}
    must_ask = buses > 1 or bare
    return Recording(path, ("--dbc", str(dbc)), history, must_ask, features)


def _frames(history: History, buses: int, identifiers: tuple[int, ...]) -> list[Any]:
    """Return frames in the order of time: stamp, bus, identifier and data of each."""
    messages = (INPUT, OUTPUT, ("PumpStroke",))
    frames = []
    for place, names in enumerate(messages):
        identifier = identifiers[place]
        time = history.readings[names[0]].time
        raw = [np.round(1e3 * history.readings[name].values) for name in names]
        for row, now in enumerate(time.tolist()):
            for bus in range(buses):
                data = np.array([column[row] for column in raw])
                data[-1] *= 1.0 - 0.3 * bus  # the second bus belongs to another machine
                stamp = round(_EPOCH + now + 1e-3 * place + 3e-4 * bus, 6)
                payload = data.astype("<i4").tobytes().ljust(8, b"\0")
                frames.append((stamp, bus, identifier, payload))
    for now in history.readings["EngineSpeed"].time.tolist():
        payload = np.array([8500, 12_000, 0, 0], dtype="<i2").tobytes()
        frames.append((round(_EPOCH + now + 4e-3, 6), 0, identifiers[3], payload))
    return sorted(frames)


def _by_python_can(path: Path, frames: list[Any]) -> None:
    import can

    with can.Logger(path) as writer:
        for stamp, bus, identifier, data in frames:
            message = can.Message(
                timestamp=stamp,
                arbitration_id=identifier,
                is_extended_id=identifier > _LARGEST_STANDARD,
                data=data,
                channel=bus + 1,
            )
            writer.on_message_received(message)


def _text(
    rng: np.random.Generator, kind: str, frames: list[Any], relative: bool
) -> str:
    """Return frames as a tool writes them."""
    lines = []
    first = frames[0][0]
    before = first
    early = float(rng.choice([0.0, 0.0, 2.5]))
    if kind == "asc":
        word = "relative" if relative else "absolute"
        lines += ["date Mon Mar 2 08:00:00.000 2026", f"base hex  timestamps {word}"]
    for stamp, bus, identifier, data in frames:
        blanks = data.hex(" ").upper()
        step = stamp - before
        before = stamp
        number = f"{identifier:03X}"
        mark = ""
        if identifier > _LARGEST_STANDARD:
            number = f"{identifier:08X}"
            mark = "x"  # as Vector tools mark 29 bits
        if kind == "log":
            lines.append(f"({stamp:.6f}) can{bus} {number}#{data.hex().upper()}")
        elif kind == "printed":
            shown = stamp - first if relative else stamp
            text = f" ({shown:017.6f})  can{bus}  {number}   [8]  {blanks}"
            lines.append(text)
        elif kind == "delta":
            lines.append(f" ({step:010.6f})  can{bus}  {number}   [8]  {blanks}")
        else:
            # A trigger of CANoe sets the zero; what was before it has stamps below zero.
            shown = step if relative else stamp - first - early
            lines.append(
                f"   {shown:.6f} {bus + 1}  {identifier:X}{mark}  Rx   d 8 {blanks}"
            )
    return "\n".join(lines) + "\n"


_WRITERS = {
    "mf4": _mf4,
    "tdms": _tdms,
    "csv": _csv,
    **dict.fromkeys(("log", "printed", "delta", "asc", "blf", "trc"), _can),
}
FORMATS = tuple(_WRITERS)
"""Kinds of files that are written."""

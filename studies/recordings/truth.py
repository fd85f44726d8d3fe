# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A random recording: steady tests of known efficiency, in one of several formats.

The files are written by the libraries that own them, or as the text that can-utils and Vector tools
write; nothing of the readers of `hmcvt_core` is used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

RATE = 20.0
"""Readings of each channel [1/s]."""
SECONDS = 9.0
"""Length of a steady test [s]."""
FORMATS = ("mf4", "tdms", "log", "printed", "delta", "asc")
NAMES = ("EngineSpeed", "EngineTorque", "OutputSpeed", "OutputTorque", "PumpStroke")
UNITS = {
    "EngineSpeed": (("rpm", 1.0), ("1/min", 1.0), ("rad/s", np.pi / 30.0)),
    "EngineTorque": (("Nm", 1.0), ("kNm", 1e-3), ("N m", 1.0)),
    "OutputSpeed": (("rpm", 1.0), ("rad/s", np.pi / 30.0)),
    "OutputTorque": (("Nm", 1.0), ("daN m", 0.1)),
    "PumpStroke": (("%", 1.0), ("\u2030", 10.0)),
}
"""Units of each channel, and their number in r/min, N m and percent."""
_START = np.datetime64("2026-03-02T08:00:00", "us")
_EPOCH = 1_772_438_400.0
_DBC = """VERSION ""

NS_ :

BS_:

BU_: BENCH

BO_ 256 INPUT: 8 BENCH
 SG_ EngineSpeed : 0|32@1+ (0.001,0) [0|4000] "rpm" BENCH
 SG_ EngineTorque : 32|32@1- (0.001,0) [-2000|2000] "Nm" BENCH

BO_ 257 OUTPUT: 8 BENCH
 SG_ OutputSpeed : 0|32@1- (0.001,0) [-4000|4000] "rpm" BENCH
 SG_ OutputTorque : 32|32@1- (0.001,0) [-4000|4000] "Nm" BENCH

BO_ 258 UNIT: 8 BENCH
 SG_ PumpStroke : 0|32@1- (0.001,0) [-110|110] "%" BENCH
"""


@dataclass(frozen=True)
class Recording:
    """A file and what it holds.

    Attributes:
        path: of the file.
        options: of the command.
        efficiency: of each test that all channels cover, shape (n,) [-].
        stroke: of the same tests, shape (n,) [-].
        must_ask: whether the file leaves something open that no reader can know.
        features: how it was written.
    """

    path: Path
    options: tuple[str, ...]
    efficiency: Any
    stroke: Any
    must_ask: bool
    features: dict[str, Any] = field(default_factory=dict)


def random_recording(rng: np.random.Generator, folder: Path) -> Recording:
    """Write a random recording.

    Args:
        rng: of all choices.
        folder: for the file and its DBC.
    """
    tests = int(rng.integers(3, 6))
    efficiency = rng.uniform(0.70, 0.92, tests)
    time, columns = _columns(rng, efficiency)
    stroke = 0.01 * columns["PumpStroke"][:: int(RATE * SECONDS)]
    truth = (efficiency, stroke)
    kind = str(rng.choice(FORMATS))
    path = folder / f"recording.{'log' if kind in ('printed', 'delta') else kind}"
    if kind == "mf4":
        return _mf4(rng, path, time, columns, truth)
    if kind == "tdms":
        return _tdms(rng, path, columns, truth)
    return _can(rng, path, kind, time, columns, truth)


def _columns(rng: np.random.Generator, efficiency: Any) -> tuple[Any, dict[str, Any]]:
    """Return times [s] and columns in r/min, N m and percent."""
    count = int(RATE * SECONDS)
    parts: dict[str, list[Any]] = {name: [] for name in NAMES}
    for value in efficiency:
        stroke = rng.uniform(-0.9, 0.9)
        engine_speed = rng.uniform(1000.0, 2000.0)
        engine_torque = rng.uniform(150.0, 500.0)
        ratio = 1.0 + 0.5 * stroke
        output_torque = engine_torque * value / ratio
        steady = (engine_speed, engine_torque, ratio * engine_speed, output_torque)
        for name, number in zip(NAMES, (*steady, 100.0 * stroke), strict=True):
            noise = 0.0 if name == "PumpStroke" else 3e-4
            parts[name].append(number * (1.0 + noise * rng.standard_normal(count)))
    columns = {name: np.concatenate(part) for name, part in parts.items()}
    return np.arange(count * len(efficiency)) / RATE, columns


def _in_units(rng: np.random.Generator, columns: Any) -> tuple[dict[str, Any], Any]:
    """Return columns in random units, and the units."""
    written = {}
    units = {}
    for name, values in columns.items():
        choice = UNITS[name][int(rng.integers(len(UNITS[name])))]
        units[name] = choice[0]
        written[name] = choice[1] * values
    return written, units


def _mf4(
    rng: np.random.Generator, path: Path, time: Any, columns: Any, truth: Any
) -> Recording:
    import asammdf

    written, units = _in_units(rng, columns)
    suffix = str(rng.choice(["", "\\ETKC:1"]))
    runs = int(rng.choice([1, 1, 2]))
    bare = bool(rng.random() < 0.2)
    on_change = bool(rng.random() < 0.3)
    mdf = asammdf.MDF(version="4.10")
    for run in range(runs):
        groups: dict[str, list[Any]] = {"fast": [], "change": []}
        for name, values in written.items():
            unit = "" if bare and name.endswith("Torque") else units[name]
            stamps = time + 1000.0 * run
            kept = values
            group = "fast"
            if on_change and name == "PumpStroke":
                changed = np.append(True, np.diff(values) != 0.0)
                stamps = stamps[changed]
                kept = values[changed]
                group = "change"
            signal = asammdf.Signal(kept, stamps, name=f"{name}{suffix}", unit=unit)
            groups[group].append(signal)
        for name, signals in groups.items():
            if signals:
                mdf.append(signals, acq_name=f"{name} {run}")
    mdf.save(path, overwrite=True)
    mdf.close()
    features = {"format": "mf4", "suffix": suffix, "runs": runs, "bare": bare}
    features["on_change"] = on_change
    return Recording(path, (), *truth, bare or runs > 1, features)


def _tdms(rng: np.random.Generator, path: Path, columns: Any, truth: Any) -> Recording:
    from nptdms import ChannelObject, TdmsWriter

    written, units = _in_units(rng, columns)
    starts = str(rng.choice(["none", "same", "late", "late", "mixed"]))
    runs = int(rng.choice([1, 1, 2]))
    length = len(written["EngineSpeed"])
    delay = int(rng.integers(1, length // 2))
    lost = 0
    if starts == "late":
        lost = int(delay / RATE / SECONDS)  # what is left of a test may suffice
    objects = []
    for run in range(runs):
        for name, values in written.items():
            is_output = name.startswith("Output")
            begin = _START + np.timedelta64(3_600_000_000 * run, "us")
            if starts == "late" and is_output:
                values = values[delay:]
                begin = begin + np.timedelta64(int(delay / RATE * 1e6), "us")
            properties = {"unit_string": units[name], "wf_increment": 1.0 / RATE}
            if starts in ("same", "late") or (starts == "mixed" and not is_output):
                properties["wf_start_time"] = begin
            objects.append(
                ChannelObject(f"Run{run}", name, values, properties=properties)
            )
    with TdmsWriter(path) as writer:
        writer.write_segment(objects)
    features = {"format": "tdms", "starts": starts, "runs": runs, "delay": delay}
    must_ask = runs > 1 or starts == "mixed"
    return Recording(path, (), truth[0][lost:], truth[1][lost:], must_ask, features)


def _can(
    rng: np.random.Generator,
    path: Path,
    kind: str,
    time: Any,
    columns: Any,
    truth: Any,
) -> Recording:
    dbc = path.with_suffix(".dbc")
    dbc.write_text(_DBC)
    buses = int(rng.choice([1, 1, 2]))
    relative = bool(rng.random() < 0.5)
    frames = []
    raw = {
        name: np.round(values * 1e3).astype("<i4") for name, values in columns.items()
    }
    pairs = {
        0x100: ("EngineSpeed", "EngineTorque"),
        0x101: ("OutputSpeed", "OutputTorque"),
        0x102: ("PumpStroke", None),
    }
    for row, now in enumerate(time):
        for place, (identifier, names) in enumerate(pairs.items()):
            data = raw[names[0]][row].tobytes()
            second = np.int32(0) if names[1] is None else raw[names[1]][row]
            for bus in range(buses):
                # The second bus belongs to another machine.
                of_bus = np.int32(int(second) * (10 - 3 * bus) // 10)
                stamp = round(_EPOCH + now + 0.001 * place + 0.0003 * bus, 6)
                frames.append((stamp, bus, identifier, data + of_bus.tobytes()))
    path.write_text(_text(kind, frames, relative))
    features = {"format": kind, "buses": buses, "relative": relative}
    return Recording(path, ("--dbc", str(dbc)), *truth, buses > 1, features)


def _text(kind: str, frames: list[Any], relative: bool) -> str:
    """Return frames as a tool writes them."""
    lines = []
    first = frames[0][0]
    before = first
    if kind == "asc":
        word = "relative" if relative else "absolute"
        lines += ["date Mon Mar 2 08:00:00.000 2026", f"base hex  timestamps {word}"]
    for stamp, bus, identifier, data in frames:
        blanks = data.hex(" ").upper()
        step = stamp - before
        before = stamp
        if kind == "log":
            lines.append(
                f"({stamp:.6f}) can{bus} {identifier:03X}#{data.hex().upper()}"
            )
        elif kind == "printed":
            shown = stamp - first if relative else stamp
            text = f" ({shown:017.6f})  can{bus}  {identifier:03X}   [8]  {blanks}"
            lines.append(text)
        elif kind == "delta":
            lines.append(
                f" ({step:010.6f})  can{bus}  {identifier:03X}   [8]  {blanks}"
            )
        else:
            shown = step if relative else stamp - first
            lines.append(f"   {shown:.6f} {bus + 1}  {identifier:X}  Rx   d 8 {blanks}")
    return "\n".join(lines) + "\n"

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A small simulated bench that moves between operating points, and the bag it is recorded in."""

import math
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from rosbags.rosbag2 import (
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
    Writer,
)
from rosbags.typesys import Stores, get_typestore

RATE = 50.0  # messages a second
START = 1_700_000_000  # s
TYPES = get_typestore(Stores.ROS2_JAZZY)
SHAFTS = "sensor_msgs/msg/JointState"
NUMBER = "std_msgs/msg/Float64"
TEMPERATURE = "sensor_msgs/msg/Temperature"
TEXT = "std_msgs/msg/String"
JOINTS = ("engine", "output", "displacement")
STORAGE = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}


class Bench(NamedTuple):
    """What the sensors say, by time, and where the bench was sent; arrays of shape (n,)."""

    time: np.ndarray
    engine_speed: np.ndarray
    engine_torque: np.ndarray
    output_speed: np.ndarray
    output_torque: np.ndarray
    displacement_ratio: np.ndarray
    hold: np.ndarray
    settled: np.ndarray

    @property
    def rows(self):
        """The five readings, shape (n, 5)."""
        return np.column_stack(self[1:6])


def lagged(drive, keep):
    """What is kept of the value before, and the drive: a first-order lag."""
    return np.array(
        list(accumulate(drive.tolist(), lambda before, new: keep * before + new))
    )


def correlated(rng, count, std, time):
    """First-order noise of a standard deviation and correlation time [s]."""
    keep = math.exp(-1.0 / (RATE * time))
    drive = rng.normal(0.0, std * math.sqrt(1.0 - keep**2), count + 500)
    return lagged(drive, keep)[500:]


def run_bench(model, points, hold=12.0, lag=0.5, noise=0.01, seed=0):
    """Drive to each point with a first-order lag and hold it.

    Args:
        model: says what the transmission does at each moment.
        points: (displacement ratio, engine speed, load torque), shape (n, 3).
        hold: time at each point, the way there included [s].
        lag: time constant of all three [s].
        noise: relative standard deviation of the torques; correlated over 0.1 s.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    points = np.asarray(points, dtype=float)
    per_hold = round(hold * RATE)
    target = np.repeat(points, per_hold, axis=0)
    count = len(target)
    keep = math.exp(-1.0 / (RATE * lag))
    state = np.column_stack(
        [
            column[0] + lagged((1.0 - keep) * (column - column[0]), keep)
            for column in target.T
        ]
    )
    ratio, speed, load = state.T
    efficiency = model.efficiency(ratio, speed, load)
    output_speed = model.output_speed(ratio, speed, load)
    # Half a kg m2 of engine has to be sped up between the points.
    engine_torque = load / efficiency + 0.5 * np.gradient(speed, 1.0 / RATE)
    output_torque = load * speed / output_speed

    def noisy(values, std):
        return values * (1.0 + correlated(rng, count, std, 0.1))

    return Bench(
        START + np.arange(count) / RATE,
        noisy(speed, 0.1 * noise),
        noisy(engine_torque, noise),
        noisy(output_speed, 0.1 * noise),
        noisy(output_torque, noise),
        ratio + rng.normal(0.0, 0.001, count),
        np.repeat(np.arange(len(points)), per_hold),
        np.all(np.abs(state - target) <= 0.02 * np.abs(target), axis=1),
    )


def stamp(seconds):
    """Time as a message; nanoseconds to the microsecond."""
    whole, rest = divmod(round(seconds * 1e6), 1_000_000)
    return TYPES.types["builtin_interfaces/msg/Time"](sec=whole, nanosec=rest * 1000)


def header(seconds, frame=""):
    return TYPES.types["std_msgs/msg/Header"](stamp=stamp(seconds), frame_id=frame)


def joint_state(row, seconds=0.0, names=JOINTS, frame=""):
    """The five readings as a message; fields that mean nothing are NaN."""
    nan = math.nan
    speed, torque, output_speed, output_torque, ratio = map(float, row)
    return TYPES.types[SHAFTS](
        header=header(seconds, frame),
        name=list(names),
        position=np.array([nan, nan, ratio][: len(names)]),
        velocity=np.array([speed, output_speed, nan][: len(names)]),
        effort=np.array([torque, output_torque, nan][: len(names)]),
    )


def text(value):
    return TYPES.types[TEXT](data=value)


def number(value):
    return TYPES.types[NUMBER](data=float(value))


def temperature(value, seconds=0.0):
    return TYPES.types[TEMPERATURE](
        header=header(seconds), temperature=float(value), variance=0.0
    )


def bench_records(
    bench, topic="/bench_sample", stamped=True, latency=0.003, frame=lambda i: ""
):
    """The messages of a bench: (topic, type, time of receipt, message)."""
    return [
        (
            topic,
            SHAFTS,
            seconds + latency,
            joint_state(row, seconds if stamped else 0.0, frame=frame(i)),
        )
        for i, (seconds, row) in enumerate(zip(bench.time, bench.rows, strict=True))
    ]


def signal_records(bench):
    """The same, each signal as numbers on a topic of its own, at times of its own."""
    kinds = {
        "/engine/speed": ("Float64", 60.0 / math.tau),
        "/engine/torque": ("Float32", 1.0),
        "/output/speed": ("Float64", 60.0 / math.tau),
        "/output/torque": ("Float64", 1.0),
        "/pump/stroke": ("Float32", 100.0),
    }
    records = [
        (
            "/note",
            "std_msgs/msg/String",
            START + 1.0,
            TYPES.types["std_msgs/msg/String"](data="warm"),
        )
    ]
    for i, (topic, (kind, size)) in enumerate(kinds.items()):
        numbers = TYPES.types[f"std_msgs/msg/{kind}"]
        records += [
            (
                topic,
                f"std_msgs/msg/{kind}",
                seconds + 0.004 * i,
                numbers(data=float(size * value)),
            )
            for seconds, value in zip(bench.time, bench[1 + i], strict=True)
            if topic != "/engine/torque" or not START + 20.0 < seconds <= START + 24.0
        ]
    return records


def write_bag(path, records, storage="mcap", topics=(), compression=None):
    """Record messages in order of receipt; `topics` are (name, type) without a message.

    `compression` is `message` or `file` for zstd.
    """
    writer = Writer(path, version=9, storage_plugin=STORAGE[storage])
    if compression is not None:
        mode = CompressionMode[compression.upper()]
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        found = {(topic, kind) for topic, kind, *_ in records} | set(topics)
        connections = {
            key: writer.add_connection(*key, typestore=TYPES) for key in sorted(found)
        }
        for topic, kind, receipt, message in sorted(
            records, key=lambda record: record[2]
        ):
            data = (
                message
                if isinstance(message, bytes)
                else bytes(TYPES.serialize_cdr(message, kind))
            )
            writer.write(connections[topic, kind], round(receipt * 1e9), data)
    return path

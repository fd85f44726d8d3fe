# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Go from a recorded bag to a diagnosis; ROS is not needed.

    python examples/bag_to_diagnosis.py                     # a demonstration
    python examples/bag_to_diagnosis.py run1 --out result   # your own rosbag2

The bag holds `bench_sample` (docs/import-bag.md). The script turns the steady parts of the bag into
bench samples, identifies the parameters, diagnoses the gap between model and bench, and writes the
report page. Without a bag, it makes one from data/simulated.csv: a bench that holds each of the 96
tests for seven seconds. It needs rosbags: pip install '.[bag]'.
"""

import argparse
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import hmcvt_core as hmcvt
from hmcvt_ros.bag import ImportSettings, import_bag
from hmcvt_tools.report import write_html

RATE = 10.0  # messages per second
HOLD = 7.0  # seconds at each test
SCATTER = 0.001  # of every reading
START = 1_700_000_000  # s
NANOSECONDS = 1_000_000_000
SHAFTS = "sensor_msgs/msg/JointState"


def demo_bag(path: Path) -> Path:
    """Record the simulated campaign as a bench would."""
    samples = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    power = samples.load_torque * samples.engine_speed
    held = np.column_stack(
        [  # engine speed and torque, output speed and torque
            samples.engine_speed,
            power / samples.efficiency / samples.engine_speed,
            samples.output_speed,
            power / samples.output_speed,
        ]
    )
    rows = np.repeat(held, round(HOLD * RATE), axis=0)
    rows *= 1.0 + SCATTER * np.random.default_rng(0).standard_normal(rows.shape)
    strokes = np.repeat(samples.displacement_ratio, round(HOLD * RATE))
    types = get_typestore(Stores.ROS2_JAZZY)
    stamp = types.types["builtin_interfaces/msg/Time"]
    header = types.types["std_msgs/msg/Header"]
    joints = types.types[SHAFTS]
    nan = np.nan
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = bag.add_connection("/bench_sample", SHAFTS, typestore=types)
        for i, (row, stroke) in enumerate(zip(rows, strokes, strict=True)):
            time = START * NANOSECONDS + round(i * NANOSECONDS / RATE)
            message = joints(
                header=header(stamp=stamp(*divmod(time, NANOSECONDS)), frame_id=""),
                name=["engine", "output", "displacement"],
                position=np.array([nan, nan, stroke]),
                velocity=np.array([row[0], row[2], nan]),
                effort=np.array([row[1], row[3], nan]),
            )
            bag.write(topic, time, bytes(types.serialize_cdr(message, SHAFTS)))
    return path


def main() -> None:
    """Run the four steps."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bag", nargs="?", type=Path, help="folder or file of a rosbag2")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("diagnosis"),
        help="folder for the results (diagnosis)",
    )
    parser.add_argument(
        "--noise",
        type=float,
        default=0.004,
        help="standard deviation of a repeated test, a fraction of efficiency (0.004)",
    )
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    try:
        bag = options.bag
        if bag is None:
            bag = options.out / "demo_bag"
            bag = bag if bag.exists() else demo_bag(bag)
        run(bag, options.out, options.noise)
    except hmcvt.HmcvtError as error:
        raise SystemExit(f"bag_to_diagnosis: {error}") from error


def run(bag: Path, out: Path, noise: float) -> None:
    """Turn a bag into samples.csv, model.yaml and report.html in a folder."""
    print(f"1. {bag}")
    samples, report = import_bag(bag, ImportSettings())
    hmcvt.write_bench(out / "samples.csv", samples)
    print(report.text())

    print("\n2. identification")
    fit = hmcvt.identify(samples)
    fit.save(out / "model.yaml")
    print(f"   mean error {100 * fit.fit_error:.2f} % on {len(samples)} samples")

    print("\n3. diagnosis")
    # The scatter within a window does not contain the scatter between tests: state the latter.
    diagnosis = hmcvt.diagnose(fit.model, samples, noise=noise)
    print(diagnosis.report().partition("\nnext tests")[0])

    write_html(diagnosis, out / "report.html")
    print(f"\n4. samples.csv, model.yaml and report.html are in {out}")


if __name__ == "__main__":
    main()

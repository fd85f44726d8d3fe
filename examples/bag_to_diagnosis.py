# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""From a recorded bag to a diagnosis, for the test engineer. ROS is not needed.

    python examples/bag_to_diagnosis.py                     # a demonstration
    python examples/bag_to_diagnosis.py run1 --out result   # your own rosbag2

The bag holds `bench_sample` (docs/import-bag.md). Four steps: the steady parts of the bag become
bench samples, the parameters are identified from them, the gap between model and bench is
diagnosed, the report page is written. Without a bag one is made from data/simulated.csv: a bench
that holds each of its 96 tests for seven seconds. Needs rosbags: pip install '.[bag]'.
"""

import argparse
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import hmcvt_core as hmcvt
from hmcvt_core.report import write_html
from hmcvt_ros.bag import ImportSettings, import_bag

RATE, HOLD = 10.0, 7.0  # messages a second, seconds at each test
SCATTER = 0.001  # of every reading, a fraction
START = 1_700_000_000  # s
NANOSECONDS = 1_000_000_000
SHAFTS = "sensor_msgs/msg/JointState"


def demo_bag(path: Path) -> Path:
    """Record the simulated campaign as its bench would have."""
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
    types, nan = get_typestore(Stores.ROS2_JAZZY), np.nan
    stamp, header, joints = (
        types.types[name]
        for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", SHAFTS)
    )
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
        help="by which a repeated test differs, a fraction of efficiency (0.004)",
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
    # The scatter within a window knows nothing of what differs from test to test: state that.
    found = hmcvt.diagnose(fit.model, samples, noise=noise)
    print(found.report().partition("\nnext tests")[0])

    write_html(found, out / "report.html")
    print(f"\n4. samples.csv, model.yaml and report.html are in {out}")


if __name__ == "__main__":
    main()

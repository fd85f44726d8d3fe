# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a real node, the bench tests of the paper, a refit (`make demo`).

The node runs as a process of its own and is reached over DDS on the loopback interface, as a
tractor's control stack would reach it over its network.
"""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

import hmcvt_core as hmcvt
from hmcvt_core.transmission.stage import speed_ratio

from .bench_player import BenchPlayer
from .inputs import OperatingPoint
from .messages import bench_sample_to_message

MODEL_FILE = "params/paper.yaml"
FITTED, HELD_BACK = (1, 2, 4, 5, 6), (3, 7, 8)
"""Tests of Table 2 that identify the model, and those it has to predict (section 4.2)."""


def main() -> int:
    """Run the demonstration; 0 when the refit made the node better."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # also into a pipe, line by line
    # Explicit, because a shell starts background jobs with SIGINT ignored.
    signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        with tempfile.TemporaryDirectory(prefix="hmcvt-demo-") as folder:
            _loopback_only(Path(folder))
            with _player(Path(folder)) as player:
                return _tell(player)
    except KeyboardInterrupt:
        print("\nInterrupted; the node has been stopped.")
        return 130
    except (TimeoutError, RuntimeError) as error:
        print(f"hmcvt demo: error: {error}", file=sys.stderr)
        return 1


# --- the story ------------------------------------------------------------------------------------


def _tell(player: BenchPlayer) -> int:
    samples = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    fitted, held_back = (", ".join(map(str, tests)) for tests in (FITTED, HELD_BACK))
    print(f"""
hmcvt predicts the efficiency of a tractor's hydromechanical CVT and serves it on ROS 2.

1. The node runs as a process of its own (ROS domain {os.environ["ROS_DOMAIN_ID"]}, loopback only).
   It starts from {MODEL_FILE}, the hydraulic parameters printed in the paper, which were not
   identified with this model and fit its bench tests badly.

2. The eight bench tests of the paper (Table 2) are played through the topics engine_speed,
   load_torque and displacement_ratio; the node answers on efficiency and
   optimal_displacement_ratio: the one that wastes least at the same engine speed and load.
""")
    before = _play_and_print(player, samples)
    print(f"""
3. Tests {fitted} are published on bench_sample, then the service ~/reidentify is called.
   Tests {held_back} are held back: the node never sees their measured efficiency.
""")
    _refit_and_print(player, samples)
    print("\n4. The same eight tests again; the node swapped its model without a restart.\n")
    after = _play_and_print(player, samples)
    print("\n5. Mean |predicted - measured| / measured:\n")
    for title, old, new in zip(("tests the refit used", "tests held back"), before, after,
                               strict=True):
        print(f"     {title:22s} {old:6.2f} %  ->  {new:5.2f} %")
    better = all(new < old for old, new in zip(before, after, strict=True))
    print("\n   The paper's own figures for the same split: 2.16 % and 1.90 %.\n"
          if better else "\n   The refit did not improve the node.\n")
    return 0 if better else 1


def _play_and_print(player: BenchPlayer, samples: hmcvt.BenchSamples) -> tuple[float, float]:
    """Hold every test; return the mean errors on the tests fitted and held back [%]."""
    print("   test   displacement   engine     load | measured  predicted   error | optimal")
    print("          ratio         [rad/s]    [N m] |      [%]        [%]     [%] |   ratio")
    print("   " + "-" * 38 + "+" + "-" * 30 + "+" + "-" * 9)
    errors = {}
    for i, measured in enumerate(samples.efficiency):
        point = OperatingPoint(*(float(column[i]) for column in (
            samples.displacement_ratio, samples.engine_speed, samples.load_torque)))
        answer = player.hold(point)
        if answer.efficiency is None or answer.optimal_displacement_ratio is None:
            raise RuntimeError(f"the node was silent in test {i + 1}")
        errors[i + 1] = 100.0 * (answer.efficiency / measured - 1.0)
        print(f"   {i + 1:3d}{'*' if i + 1 in HELD_BACK else ' '} {point.displacement_ratio:+13.2f}"
              f"{point.engine_speed:10.2f}{point.load_torque:9.1f} |{100 * measured:9.1f}"
              f"{100 * answer.efficiency:11.1f}{errors[i + 1]:+8.1f} |"
              f"{answer.optimal_displacement_ratio:+8.3f}")
    of_fitted, of_held_back = (sum(abs(errors[test]) for test in tests) / len(tests)
                               for tests in (FITTED, HELD_BACK))
    print(f"   * held back.  Mean |error|: {of_fitted:.1f} % on tests "
          f"{', '.join(map(str, FITTED))}; {of_held_back:.1f} % on tests "
          f"{', '.join(map(str, HELD_BACK))}.")
    return of_fitted, of_held_back


def _refit_and_print(player: BenchPlayer, samples: hmcvt.BenchSamples) -> None:
    for test in FITTED:
        player.send_sample(bench_message(samples, test - 1))
    if not player.wait_for_logged(len(FITTED)):
        raise TimeoutError("the node did not log the bench samples")
    success, result = player.call("reidentify")
    if not success:
        raise RuntimeError(f"~/reidentify: {result['error']}")
    print(f"   refitted to {result['samples']} samples in {result['seconds']:.1f} s, in a process "
          "of its own:")
    for name, entry in result["parameters"].items():
        error = entry.get("standard_error")
        spread = "" if error is None else f" +- {error:.2g}"
        print(f"     {name:15s} {entry['value']:.4g}{spread} {entry['unit']}")
    for warning in result["warnings"]:
        print(f"     note: {warning}")


def bench_message(samples: hmcvt.BenchSamples, i: int) -> JointState:
    """Return a bench message with the shaft powers of sample i.

    Table 2 has no output speed. A bench sample needs one; without slip it is eq. (5).
    """
    stage = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
    ratio, speed = float(samples.displacement_ratio[i]), float(samples.engine_speed[i])
    power = float(samples.load_torque[i]) * speed
    output_speed = speed * float(speed_ratio(stage, samples.displacement_ratio[i]))
    return bench_sample_to_message(
        ratio, speed, power / float(samples.efficiency[i]) / speed, output_speed,
        power / output_speed)


# --- processes ------------------------------------------------------------------------------------


def _interrupt(number: int, frame: object) -> None:
    # A second Ctrl-C must not keep the first from stopping the node.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


def _loopback_only(folder: Path) -> None:
    """Keep the demonstration to this machine, to itself and to a folder that goes away."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 101)
    os.environ["ROS_LOG_DIR"] = str(folder / "log")


@contextmanager
def _player(folder: Path) -> Iterator[BenchPlayer]:
    """Run the node as a process of its own, and yield a client of it."""
    output = folder / "node.log"
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with output.open("w") as log, subprocess.Popen(
            [sys.executable, "-m", "hmcvt_ros.efficiency_node", "--ros-args",
             "-p", f"model_file:={hmcvt.data_path(MODEL_FILE)}",
             "-p", f"state_folder:={folder / 'state'}"],
            stdout=log, stderr=log, start_new_session=True) as process:
        player = BenchPlayer()
        try:
            if not player.wait_for_node(running=lambda: process.poll() is None):
                raise TimeoutError("the node did not come up")
            yield player
        except (TimeoutError, RuntimeError):
            print(f"The node said:\n{output.read_text()}", file=sys.stderr)
            raise
        finally:
            player.close()
            rclpy.try_shutdown()
            process.send_signal(signal.SIGINT)
            try:
                process.wait(timeout=5.0)
            except subprocess.TimeoutExpired:
                process.kill()


if __name__ == "__main__":
    sys.exit(main())

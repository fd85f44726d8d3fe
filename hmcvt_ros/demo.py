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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

import hmcvt_core as hmcvt
from hmcvt_core.physics.published import speed_ratio

from .bench_player import Answer, BenchPlayer
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
            with _node(Path(folder)) as process, _player(process) as player:
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
    print(f"""
hmcvt predicts the efficiency of a tractor's hydromechanical CVT and serves it on ROS 2.

1. The node runs as a process of its own (ROS domain {os.environ["ROS_DOMAIN_ID"]}, loopback only).
   It starts from {MODEL_FILE}, the hydraulic parameters printed in the paper, which were not
   identified with this model and fit its bench tests badly.

2. The eight bench tests of the paper (Table 2) are played through the topics engine_speed,
   load_torque and displacement_ratio; the node answers on efficiency and
   optimal_displacement_ratio: the one that wastes least at the same engine speed and load.
""")
    before = _play(player, samples)
    _print_table(samples, before)
    print(f"""
3. Tests {_listed(FITTED)} are published on bench_sample, then the service ~/reidentify is called.
   Tests {_listed(HELD_BACK)} are held back: the node never sees their measured efficiency.
""")
    _print_refit(_refit(player, samples))
    print("\n4. The same eight tests again; the node swapped its model without a restart.\n")
    after = _play(player, samples)
    _print_table(samples, after)
    return _print_improvement(samples, before, after)


def _play(player: BenchPlayer, samples: hmcvt.BenchSamples) -> list[Answer]:
    return [player.hold(OperatingPoint(*map(float, point)))
            for point in zip(samples.displacement_ratio, samples.engine_speed,
                             samples.load_torque, strict=True)]


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


def _refit(player: BenchPlayer, samples: hmcvt.BenchSamples) -> dict[str, Any]:
    for test in FITTED:
        player.send_sample(bench_message(samples, test - 1))
    if not player.wait_for_logged(len(FITTED)):
        raise TimeoutError("the node did not log the bench samples")
    reply = player.call("reidentify")
    if not reply.success:
        raise RuntimeError(f"~/reidentify: {reply.data['error']}")
    return reply.data


# --- printing -------------------------------------------------------------------------------------


def _print_table(samples: hmcvt.BenchSamples, answers: Sequence[Answer]) -> None:
    print("   test   displacement   engine     load | measured  predicted   error | optimal")
    print("          ratio         [rad/s]    [N m] |      [%]        [%]     [%] |   ratio")
    print("   " + "-" * 38 + "+" + "-" * 30 + "+" + "-" * 9)
    for i, answer in enumerate(answers):
        error = _error(samples, answers, i)
        held = "*" if i + 1 in HELD_BACK else " "
        print(f"   {i + 1:3d}{held} {samples.displacement_ratio[i]:+13.2f}"
              f"{samples.engine_speed[i]:10.2f}{samples.load_torque[i]:9.1f} |"
              f"{100 * samples.efficiency[i]:9.1f}{_percent(answer.efficiency):>11}"
              f"{_percent(error, '+'):>8} |{_ratio(answer.optimal_displacement_ratio):>8}")
    print(f"   * held back.  Mean |error|: {_mean(samples, answers, FITTED):.1f} % on tests "
          f"{_listed(FITTED)}; {_mean(samples, answers, HELD_BACK):.1f} % on tests "
          f"{_listed(HELD_BACK)}.")


def _print_refit(result: dict[str, Any]) -> None:
    print(f"   refitted to {result['samples']} samples in {result['seconds']:.1f} s, in a process "
          "of its own:")
    for name, entry in result["parameters"].items():
        error = entry.get("standard_error")
        spread = "" if error is None else f" +- {error:.2g}"
        print(f"     {name:15s} {entry['value']:.4g}{spread} {entry['unit']}")
    for warning in result["warnings"]:
        print(f"     note: {warning}")


def _print_improvement(
    samples: hmcvt.BenchSamples, before: Sequence[Answer], after: Sequence[Answer]
) -> int:
    print("\n5. Mean |predicted - measured| / measured:\n")
    better = True
    for title, tests in (("tests the refit used", FITTED), ("tests held back", HELD_BACK)):
        old, new = _mean(samples, before, tests), _mean(samples, after, tests)
        better = better and new < old
        print(f"     {title:22s} {old:6.2f} %  ->  {new:5.2f} %")
    print("\n   The paper's own figures for the same split: 2.16 % and 1.90 %.\n"
          if better else "\n   The refit did not improve the node.\n")
    return 0 if better else 1


def _error(samples: hmcvt.BenchSamples, answers: Sequence[Answer], i: int) -> float | None:
    predicted = answers[i].efficiency
    return None if predicted is None else predicted / float(samples.efficiency[i]) - 1.0


def _mean(
    samples: hmcvt.BenchSamples, answers: Sequence[Answer], tests: Sequence[int]
) -> float:
    errors = [_error(samples, answers, test - 1) for test in tests]
    if None in errors:
        raise RuntimeError(f"the node was silent in one of the tests {_listed(tests)}")
    return 100.0 * sum(abs(error) for error in errors if error is not None) / len(errors)


def _percent(value: float | None, sign: str = "-") -> str:
    return "silent" if value is None else f"{100 * value:{sign}.1f}"


def _ratio(value: float | None) -> str:
    return "silent" if value is None else f"{value:+.3f}"


def _listed(tests: Sequence[int]) -> str:
    return ", ".join(map(str, tests))


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
def _node(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run the node as a process of its own."""
    output = folder / "node.log"
    with output.open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "hmcvt_ros.efficiency_node", "--ros-args",
             "-p", f"model_file:={hmcvt.data_path(MODEL_FILE)}",
             "-p", f"state_folder:={folder / 'state'}"],
            stdout=log, stderr=log, start_new_session=True)
        try:
            yield process
        except (TimeoutError, RuntimeError):
            print(f"The node said:\n{output.read_text()}", file=sys.stderr)
            raise
        finally:
            _stop(process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    try:
        process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def _player(process: subprocess.Popen[bytes]) -> Iterator[BenchPlayer]:
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    player = BenchPlayer()
    try:
        if not player.wait_for_node(running=lambda: process.poll() is None):
            raise TimeoutError("the node did not come up")
        yield player
    finally:
        player.close()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())

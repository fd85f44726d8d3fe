# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Show a node that serves the bench tests of the paper and refits itself: `make demo`, first half.

The node runs as a separate process and is reached over DDS on the loopback interface, as a
tractor's control stack reaches it over its network.

    python examples/demo.py

The second half, a withheld cause, is `python -m studies.withheld`.
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import rclpy
from bench_player import BenchPlayer, bench_message
from rclpy.signals import SignalHandlerOptions

import hmcvt_core as hmcvt
from hmcvt_ros.inputs import OperatingPoint

MODEL_FILE = "params/paper.yaml"
# Tests of Table 2, split as in section 4.2.
FITTED = (1, 2, 4, 5, 6)
HELD_BACK = (3, 7, 8)


def story(player: BenchPlayer) -> int:
    """Serve, refit, serve again; return 0 when the refit improved the node."""
    samples = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    print(f"""
hmcvt predicts the efficiency of a tractor's hydromechanical CVT and serves it on ROS 2.

1. The node runs as a separate process (ROS domain {os.environ["ROS_DOMAIN_ID"]}, loopback only).
   It starts from {MODEL_FILE}, the hydraulic parameters printed in the paper, which were not
   identified with this model and fit the bench tests badly.

2. The eight bench tests of the paper (Table 2) are played through the topics engine_speed,
   load_torque and displacement_ratio; the node answers on efficiency and
   optimal_displacement_ratio, the one with the least loss at the same engine speed and load.
""")
    before = play(player, samples)
    print(f"""
3. Tests {str(FITTED)[1:-1]} are published on bench_sample, then the service ~/reidentify is called.
   Tests {str(HELD_BACK)[1:-1]} are held out: the node never sees their measured efficiency.
""")
    refit(player, samples)
    print(
        "\n4. The same eight tests again; the node replaced its model without a restart.\n"
    )
    after = play(player, samples)
    print("\n5. Mean |predicted - measured| / measured:\n")
    print(
        f"     tests the refit used   {before[0]:6.2f} %  ->  {after[0]:5.2f} %\n"
        f"     tests held out         {before[1]:6.2f} %  ->  {after[1]:5.2f} %\n"
    )
    if not (after[0] < before[0] and after[1] < before[1]):
        print("   The refit did not improve the node.\n")
        return 1
    print("   The paper's own figures for the same split: 2.16 % and 1.90 %.\n")
    return 0


def play(player: BenchPlayer, samples: hmcvt.BenchSamples) -> list[float]:
    """Hold every test; return the mean errors on the tests fitted and held out [%]."""
    print(
        "   test   displacement   engine     load | measured  predicted   error | optimal\n"
        "          ratio         [rad/s]    [N m] |      [%]        [%]     [%] |   ratio"
    )
    print(f"   {'-' * 38}+{'-' * 30}+{'-' * 9}")
    errors = {}
    for test, measured in enumerate(samples.efficiency, start=1):
        point = OperatingPoint(
            *(
                float(getattr(samples, name)[test - 1])
                for name in OperatingPoint._fields
            )
        )
        efficiency, optimum = player.hold(point)
        if efficiency is None or optimum is None:
            raise RuntimeError(f"the node was silent in test {test}")
        errors[test] = 100.0 * (efficiency / measured - 1.0)
        print(
            f"   {test:3d}{'*' if test in HELD_BACK else ' '} {point.displacement_ratio:+13.2f}"
            f"{point.engine_speed:10.2f}{point.load_torque:9.1f} |{100 * measured:9.1f}"
            f"{100 * efficiency:11.1f}{errors[test]:+8.1f} |{optimum:+8.3f}"
        )
    means = [
        sum(abs(errors[test]) for test in tests) / len(tests)
        for tests in (FITTED, HELD_BACK)
    ]
    print(
        f"   * held out.  Mean |error|: {means[0]:.1f} % on tests {str(FITTED)[1:-1]}; "
        f"{means[1]:.1f} % on tests {str(HELD_BACK)[1:-1]}."
    )
    return means


def refit(player: BenchPlayer, samples: hmcvt.BenchSamples) -> None:
    """Send the tests to fit, and call the refit."""
    for test in FITTED:
        player.send_sample(bench_message(samples, test - 1))
    if not player.wait_for_logged(len(FITTED)):
        raise TimeoutError("the node did not log the bench samples")
    success, result = player.call("reidentify", timeout=120.0)
    if not success:
        raise RuntimeError(f"~/reidentify: {result['error']}")
    print(
        f"   refitted to {result['samples']} samples in {result['seconds']:.1f} s, in a "
        "separate process:"
    )
    for name, entry in result["parameters"].items():
        spread = (
            f" +- {entry['standard_error']:.2g}" if entry.get("standard_error") else ""
        )
        print(f"     {name:15s} {entry['value']:.4g}{spread} {entry['unit']}")
    for warning in result["warnings"]:
        print(f"     note: {warning}")


def main(folder: Path) -> int:
    """Run the node, show the story, and end the node in any case."""
    sys.stdout.reconfigure(line_buffering=True)  # also into a pipe
    for number in (
        signal.SIGINT,
        signal.SIGTERM,
    ):  # a shell's background jobs ignore SIGINT
        signal.signal(number, signal.default_int_handler)
    os.environ.update(
        ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
        ROS_LOG_DIR=str(folder),
        ROS_DOMAIN_ID=str(51 + os.getpid() % 51),
    )
    log = folder / "node.log"
    with (
        log.open("w") as output,
        subprocess.Popen(
            [
                sys.executable,
                "-m",
                "hmcvt_ros.efficiency_node",
                "--ros-args",
                "-p",
                f"model_file:={hmcvt.data_path(MODEL_FILE)}",
                "-p",
                f"state_folder:={folder / 'state'}",
            ],
            stdout=output,
            stderr=output,
            start_new_session=True,
        ) as node,
    ):
        try:
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            player = BenchPlayer()
            if not player.wait_for_node(running=lambda: node.poll() is None):
                raise TimeoutError("the node did not come up")
            return story(player)
        except KeyboardInterrupt:
            print("\nInterrupted; the node has been stopped.")
            return 130
        except (TimeoutError, RuntimeError) as error:
            sys.exit(f"The node said:\n{log.read_text()}\nhmcvt demo: error: {error}")
        finally:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C
            rclpy.try_shutdown()
            node.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                node.wait(5.0)
            node.kill()  # nothing happens when it has ended


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="hmcvt-demo-") as name:
        sys.exit(main(Path(name)))

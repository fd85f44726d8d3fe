# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The same campaigns diagnosed through the node and by the command line.

    python -m studies.soak.verdicts [CAMPAIGNS] [SEED]

Each campaign has a withheld effect or none, and a random choice of the columns that a bench may
state. Its samples go to a node as messages and into a bench file; `~/diagnose` and
`hmcvt diagnose --json` must give the same verdict and the same sets of effects.
"""

import contextlib
import io
import json
import math
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from numpy.random import Generator
from sensor_msgs.msg import JointState

import hmcvt_core as hmcvt
from examples.bench_player import BenchPlayer, bench_sample_to_message
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_tools.cli import main as command_line

from . import processes

MODEL_FILE = hmcvt.data_path("params/hm4.yaml")
NOISE = 0.002
"""Standard deviation of the efficiency [-]."""
SAMPLES = 40
CAMPAIGNS = 100
STATED = ("oil_temperature", "pressure", "efficiency_std", "session")
"""Columns that a campaign may lack."""
_CLOSE = 1e-3
"""Difference of probabilities that rounding of the messages explains."""
_DIGITS = 10
"""Digits of a number in a bench file; the node's log keeps 14."""
_PATIENCE = 600.0
"""Time for a node on a busy machine [s]."""


def draw(rng: Generator) -> hmcvt.BenchSamples:
    """Draw the samples of one campaign."""
    base = hmcvt.load_model(MODEL_FILE)
    effects: list[tuple[Any, ...]] = [
        (),
        (OilTemperature(float(rng.uniform(0.5, 2.0))),),
        (ChargePump(float(rng.uniform(1.0, 5.0))),),
    ]
    truth = replace(base, effects=effects[int(rng.integers(len(effects)))])
    samples = hmcvt.BenchSamples(
        rng.uniform(-1.0, 1.0, SAMPLES),
        rng.uniform(80.0, 220.0, SAMPLES),
        rng.uniform(80.0, 300.0, SAMPLES),
        np.full(SAMPLES, 0.5),
    )
    oil = np.round(rng.uniform(40.0, 80.0, SAMPLES), 1)
    read = truth.readings_at(samples.points._replace(oil_temperature=oil))
    columns: dict[str, Any] = {
        "oil_temperature": oil,
        "pressure": read["pressure"],
        "efficiency_std": np.full(SAMPLES, NOISE),
    }
    stated = [name for name in STATED if rng.random() < 0.7]
    extra = {}
    if "session" in stated:
        extra["session"] = tuple(str(2 * i // SAMPLES) for i in range(SAMPLES))
    drawn = replace(
        samples,
        efficiency=read["efficiency"] + rng.normal(0.0, NOISE, SAMPLES),
        output_speed=read["output_speed"],
        stamp=1000.0 + 60.0 * np.arange(SAMPLES),
        extra=extra,
        **{name: columns[name] for name in stated if name in columns},
    )
    written = {
        name: np.array([float(f"{value:.{_DIGITS}g}") for value in column])
        for name, column in drawn.columns.items()
        if column is not None
    }
    return replace(drawn, **written)


def message_of(samples: hmcvt.BenchSamples, i: int) -> JointState:
    """Return the message of a sample."""
    speed = float(samples.engine_speed[i])
    output_speed = float(samples.output_speed[i])
    load = float(samples.load_torque[i])
    message = bench_sample_to_message(
        samples.displacement_ratio[i],
        speed,
        load / samples.efficiency[i],
        output_speed,
        load * speed / output_speed,
    )
    values = {name: getattr(samples, name, None) for name in STATED[:-1]}
    values["session"] = samples.extra.get("session")
    for name, column in values.items():
        if column is not None:
            message.name.append(name)
            message.position.append(float(column[i]))
            message.velocity.append(math.nan)
            message.effort.append(math.nan)
    message.header.stamp.sec = round(samples.stamp[i])
    return message


def through_the_node(
    player: BenchPlayer, samples: hmcvt.BenchSamples, log: Path
) -> dict[str, Any]:
    """Return the answer of `~/diagnose` to samples that are sent as messages."""
    player.call("clear_samples", _PATIENCE)
    for i in range(len(samples)):
        player.send_sample(message_of(samples, i))

    def written() -> bool:
        return log.exists() and log.read_bytes().count(b"\n") == len(samples) + 1

    if not player.wait_until(written, _PATIENCE):
        raise TimeoutError(f"{log}: the samples did not arrive")
    return dict(player.call("diagnose", _PATIENCE).data)


def by_command(samples: hmcvt.BenchSamples, folder: Path) -> dict[str, Any]:
    """Return the object of `hmcvt diagnose --json`."""
    path = folder / "bench.csv"
    hmcvt.write_bench(path, samples)
    words = ["diagnose", str(path), "--json", "--params", str(MODEL_FILE)]
    with (
        contextlib.redirect_stdout(io.StringIO()) as printed,
        contextlib.suppress(SystemExit),
    ):
        command_line(words)
    return dict(json.loads(printed.getvalue()))


def differences(answer: Mapping[str, Any], expected: Mapping[str, Any]) -> list[str]:
    """Return in what two diagnoses differ."""
    if "verdict" not in answer:
        return [f"the node answers {answer}"]
    found = []
    if answer["verdict"] != expected["verdict"]:
        found.append(f"verdict {answer['verdict']}, expected {expected['verdict']}")
    sets = [each["effects"] for each in answer["sets"]]
    expected_sets = [each["effects"] for each in expected["sets"]]
    if sets != expected_sets:
        found.append(f"sets {sets}, expected {expected_sets}")
        return found
    for one, other in zip(answer["sets"], expected["sets"], strict=True):
        if abs(one["probability"] - other["probability"]) > _CLOSE:
            found.append(f"{one['effects']}: another probability")
    return found


def main() -> int:
    """Run the campaigns; the exit code is 1 when a diagnosis differs."""
    numbers = [int(text) for text in sys.argv[1:]]
    count, seed = (*numbers, *(CAMPAIGNS, 0)[len(numbers) :])
    rng = np.random.default_rng(seed)
    different = 0
    with tempfile.TemporaryDirectory(prefix="hmcvt-verdicts-") as name:
        folder = Path(name)
        processes.loopback_only(folder)
        rclpy.init()
        player = BenchPlayer(namespace="/verdicts")
        with processes.node("/verdicts", folder, model_file=MODEL_FILE) as node:
            if not player.wait_for_node(_PATIENCE, running=lambda: node.running):
                raise TimeoutError(f"the node did not come up:\n{node.log}")
            log = folder / "verdicts" / "bench_samples.csv"
            for number in range(count):
                samples = draw(rng)
                answer = through_the_node(player, samples, log)
                found = differences(answer, by_command(samples, folder))
                different += bool(found)
                verdict = answer.get("verdict")
                text = "; ".join(found) or "the same"
                print(f"{number + 1}: {verdict}: {text}", flush=True)
        rclpy.shutdown()
    print(f"{count} campaigns, seed {seed}: {different} differ")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())

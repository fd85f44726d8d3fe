# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The trials: steady load, rising load, load during refits, and nonsense.

The node and the relay take turns, so that whatever else the machine does meets both.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_ros import qos

from . import points, processes
from .fuzz_bench import BenchFuzzer
from .fuzz_inputs import DEPTH, InputFuzzer, overrides
from .load import Segment, Target, client
from .points import ORDINARY, Cycle

Say = Callable[[str], None]
_BATCH = 80  # fewer than the node's subscription holds
_NOISE = 0.004  # of the efficiency
_LOSSLESS = QoSProfile(depth=DEPTH)
_PATIENCE = 30.0  # seconds


@dataclass(frozen=True)
class Plan:
    """How much of everything.

    Attributes:
        rate: of each input in the steady trials [Hz].
        seconds, turns: length of a stretch of load, and how many the node and the relay get each.
        refit_turns: the same during refits.
        samples: bench samples of a refit.
        rates, rising_seconds: the trial with a rising rate.
        fuzz: messages of nonsense.
        cycle: arrivals before the values repeat.
        seed: of everything random.
        lossless: whether the node hears every arrival, and none too late, however the machine
            stalls; otherwise its inputs are as delivered.
    """

    rate: float = 300.0
    seconds: float = 10.0
    turns: int = 6
    refit_turns: int = 4
    samples: int = 2000
    rates: tuple[float, ...] = (
        300.0,
        500.0,
        750.0,
        1000.0,
        1250.0,
        1500.0,
        2000.0,
        2500.0,
        3000.0,
    )
    rising_seconds: float = 5.0
    fuzz: int = 100_000
    cycle: int = 3000
    seed: int = 0
    lossless: bool = False


class Turn(NamedTuple):
    """The node under the load, refitting or not, then the relay with the machine to itself."""

    node: Segment
    relay: Segment


@dataclass(frozen=True)
class Loaded:
    """What the trials under load showed.

    Attributes:
        steady, refitting: turns of the node and the relay.
        rising, rising_relay: stretches with a rising rate.
        refits: how many refits ended meanwhile, and how long one took alone [s].
        memory: bytes that the node held after the trials: start, steady, rising, refits.
    """

    steady: list[Turn]
    rising: list[Segment]
    rising_relay: list[Segment]
    refitting: list[Turn]
    refits: tuple[int, float]
    memory: tuple[int, ...]


@dataclass(frozen=True)
class Fuzzed:
    """What nonsense did to the node.

    Attributes:
        sent: messages.
        answers: on `efficiency`, all of them due.
        logged: bench samples, all of them due.
        differences: broken promises.
        seconds: it took.
        exit_code: of the node, asked to end.
        survived: whether the process was there to be asked, without a traceback in its log.
    """

    sent: int
    answers: int
    logged: int
    differences: tuple[str, ...]
    seconds: float
    exit_code: int
    survived: bool


def under_load(plan: Plan, folder: Path, say: Say = print) -> Loaded:
    """Run the trials under load."""
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    given = overrides("/node") if plan.lossless else {}
    sender = (_LOSSLESS, _PATIENCE) if plan.lossless else ()
    with (
        client() as here,
        processes.node("/node", folder, **given) as node,
        processes.relay("/relay", folder) as relay,
    ):
        served, bare = (
            Target(here, node, "/node", *sender),
            Target(here, relay, "/relay"),
        )
        answered = points.answered(model, plan.cycle, plan.seed)
        echoed = points.echoed(plan.cycle, plan.seed)
        for target in (served, bare):
            target.wait()
        memory = [node.memory()]
        say(f"Steady load, {plan.rate:g} Hz on each input ...")
        steady = [
            Turn(
                served.counted(answered, plan.rate, plan.seconds),
                bare.load(echoed, plan.rate, plan.seconds),
            )
            for _ in range(plan.turns)
        ]
        memory.append(node.memory())
        say("Rising load ...")
        rising, rising_relay = (
            _rising(target, cycle, plan.rates, plan.rising_seconds)
            for target, cycle in ((served, answered), (bare, echoed))
        )
        memory.append(node.memory())
        say("The steady load again, during refits ...")
        refits = Refits(here, served, "/node")
        refits.log_samples(model, plan.samples, plan.seed)
        refitting = _during_refits(plan, refits, folder / "node", served, bare, echoed)
        memory.append(node.memory())
    return Loaded(
        steady,
        rising,
        rising_relay,
        refitting,
        (len(refits.replies), refits.replies[0]["seconds"]),
        tuple(memory),
    )


def _rising(
    target: Target, cycle: Cycle, rates: Sequence[float], seconds: float
) -> list[Segment]:
    """Raise the rate until a tenth of the arrivals is not answered."""
    found: list[Segment] = []
    for rate in rates:
        found.append(target.load(cycle, rate, seconds))
        if found[-1].answers < 0.9 * found[-1].sent:
            break
    return found


def _during_refits(
    plan: Plan, refits: Refits, state: Path, served: Target, bare: Target, echoed: Cycle
) -> list[Turn]:
    """Load the node while it refits itself all the time, and the relay without that.

    The refits are all of the same samples, so that the first one tells what the node will serve;
    it names the file as within its `state` folder.
    """
    refits.poll()
    model = hmcvt.load_model(state / refits.finish()["file"])
    cycle = points.answered(model, plan.cycle, plan.seed)
    found = []
    for _ in range(plan.refit_turns):
        node = served.counted(cycle, plan.rate, plan.seconds, refits.poll)
        refits.finish()
        found.append(Turn(node, bare.load(echoed, plan.rate, plan.seconds)))
    return found


def nonsense(plan: Plan, folder: Path, say: Say = print) -> Fuzzed:
    """Send nonsense to a node of its own: a tenth on `bench_sample`."""
    say(f"{plan.fuzz} messages of nonsense ...")
    start = time.monotonic()
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    with (
        client() as here,
        processes.node("/fuzz", folder, **overrides("/fuzz")) as node,
    ):
        target = Target(here, node, "/fuzz", _LOSSLESS)
        target.wait()
        inputs = InputFuzzer(target, model, plan.seed)
        inputs.run(plan.fuzz * 9 // 10)
        bench = BenchFuzzer(
            target,
            here.create_publisher(JointState, "/fuzz/bench_sample", _LOSSLESS),
            folder / "fuzz/bench_samples.csv",
            plan.seed,
        )
        bench.run(plan.fuzz - inputs.sent)
        alive = node.running
        return Fuzzed(
            inputs.sent + bench.sent,
            inputs.oracle.answers,
            len(bench.rows),
            (*inputs.differences, *bench.differences),
            time.monotonic() - start,
            node.stop(),
            alive and "Traceback" not in node.log,
        )


class Refits:
    """Calls `~/reidentify` again and again.

    Attributes:
        replies: what was answered, as JSON objects.
    """

    def __init__(self, client: Node, target: Target, namespace: str) -> None:
        self._target = target
        self._client = client.create_client(Trigger, f"{namespace}/hmcvt/reidentify")
        self._samples = client.create_publisher(
            JointState, f"{namespace}/bench_sample", qos.BENCH_SAMPLE
        )
        self._waiting = False
        self.replies: list[dict[str, Any]] = []

    def log_samples(self, model: hmcvt.EfficiencyModel, count: int, seed: int) -> None:
        """Have the node log bench samples: what a model gives, with noise.

        Raises:
            TimeoutError: it does not log them.
        """
        random = np.random.default_rng(seed)
        for number in range(1, count + 1):
            point = random.uniform(*np.transpose(ORDINARY))
            efficiency = float(model.efficiency(*point)) * (
                1 + _NOISE * random.standard_normal()
            )
            speed, load = map(float, point[1:])
            output_speed = float(model.output_speed(*point))
            self._samples.publish(
                bench_sample_to_message(
                    point[0],
                    speed,
                    load / efficiency,
                    output_speed,
                    load * speed / output_speed,
                )
            )
            if number % _BATCH and number < count:
                continue
            if not self._target.ear.listen_until(
                lambda logged=number: (
                    self._target.statuses.sum("model", "logged") == logged
                ),
                30.0,
            ):
                raise TimeoutError(
                    f"bench samples are not logged:\n{self._target.process.log}"
                )

    def poll(self) -> None:
        """Take the reply to the running refit, if it is there, and start the next."""
        self._take()
        if not self._waiting:
            self._waiting = True
            self._client.call_async(Trigger.Request())

    def finish(self, timeout: float = 120.0) -> dict[str, Any]:
        """Wait for the running refit; return its reply.

        Raises:
            TimeoutError: there is none.
            RuntimeError: it failed.
        """

        def ended() -> bool:
            self._take()
            return not self._waiting

        if not self._target.ear.listen_until(ended, timeout):
            raise TimeoutError(f"a refit does not end:\n{self._target.process.log}")
        return self.replies[-1]

    def _take(self) -> None:
        header, response = self._client.handle.take_response(Trigger.Response)
        if header is None:
            return
        self._waiting = False
        reply = json.loads(response.message)
        if not response.success:
            raise RuntimeError(f"~/reidentify: {reply['error']}")
        self.replies.append(reply)

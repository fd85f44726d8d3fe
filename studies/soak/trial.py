# SPDX-License-Identifier: Apache-2.0
"""The whole trial: what is done, for how long, and what comes of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

import hmcvt_core as hmcvt

from . import phases, points, processes
from .fuzz_bench import BenchFuzzer
from .fuzz_inputs import InputFuzzer, overrides
from .load import Segment, Target
from .refits import Refits

Say = Callable[[str], None]


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
    """

    rate: float = 300.0
    seconds: float = 10.0
    turns: int = 6
    refit_turns: int = 4
    samples: int = 2000
    rates: tuple[float, ...] = (300.0, 500.0, 750.0, 1000.0, 1250.0, 1500.0, 2000.0, 2500.0, 3000.0)
    rising_seconds: float = 5.0
    fuzz: int = 100_000
    cycle: int = 3000
    seed: int = 0


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


@dataclass(frozen=True)
class Loaded:
    """What the trials under load showed.

    Attributes:
        steady, refitting: turns of the node and the relay.
        rising, rising_relay: stretches with a rising rate.
        refits: how many refits ended meanwhile, and how long one took alone [s].
        memory: bytes that the node held after the trials: start, steady, rising, refits.
    """

    steady: list[phases.Turn]
    rising: list[Segment]
    rising_relay: list[Segment]
    refitting: list[phases.Turn]
    refits: tuple[int, float]
    memory: tuple[int, ...]


@contextmanager
def client() -> Iterator[Node]:
    """Make the ROS node through which this process sends and hears."""
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("soak", context=context)
    try:
        yield node
    finally:
        node.destroy_node()
        context.try_shutdown()


def under_load(plan: Plan, folder: Path, say: Say = print) -> Loaded:
    """Run the trials under load."""
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    with (client() as here, processes.node("/node", folder) as node,
          processes.relay("/relay", folder) as relay):
        targets = Target(here, node, "/node"), Target(here, relay, "/relay")
        bench = phases.Bench(*targets, model, points.answered(model, plan.cycle, plan.seed),
                             points.echoed(plan.cycle, plan.seed), plan.seed)
        for target in targets:
            target.wait()
        memory = [node.memory()]
        say(f"Steady load, {plan.rate:g} Hz on each input ...")
        steady = phases.steady(bench, plan.rate, plan.seconds, plan.turns)
        memory.append(node.memory())
        say("Rising load ...")
        rising, rising_relay = (
            phases.rising(target, cycle, plan.rates, plan.rising_seconds) for target, cycle in
            ((bench.node, bench.node_cycle), (bench.relay, bench.relay_cycle)))
        memory.append(node.memory())
        say("The steady load again, during refits ...")
        refits = Refits(here, "/node")
        refitting = phases.during_refits(
            bench, refits, plan.rate, plan.seconds, plan.refit_turns, plan.samples)
        memory.append(node.memory())
    return Loaded(steady, rising, rising_relay, refitting,
                  (len(refits.replies), refits.replies[0]["seconds"]), tuple(memory))


def nonsense(plan: Plan, folder: Path, say: Say = print) -> Fuzzed:
    """Send nonsense to a node of its own: a tenth on `bench_sample`."""
    say(f"{plan.fuzz} messages of nonsense ...")
    start = time.monotonic()
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    with client() as here, processes.node("/fuzz", folder, **overrides("/fuzz")) as node:
        inputs = InputFuzzer(here, node, "/fuzz", model, plan.seed)
        inputs.run(plan.fuzz * 9 // 10)
        bench = BenchFuzzer(here, node, "/fuzz", folder / "fuzz/bench_samples.csv", plan.seed)
        bench.run(plan.fuzz - inputs.sent)
        alive = node.running
        return Fuzzed(
            inputs.sent + bench.sent, inputs.oracle.answers, len(bench.rows),
            (*inputs.differences, *bench.differences), time.monotonic() - start, node.stop(),
            alive and "Traceback" not in node.log)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The time from an arrival to its answer at several rates, of the node and of a bare relay.

    python -m studies.soak.latency [--turns N] [--seconds S] [--out PAGE]

The node and the relay take turns in one run, so that whatever else the machine does meets both. The
arrivals come on the three inputs, one after the other, or on `operating_point`.
"""

import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState

import hmcvt_core as hmcvt
from examples.bench_player import bench_sample_to_message
from hmcvt_ros import qos
from studies.page import (
    Goal,
    Spread,
    busy_cores,
    goal_table,
    machine,
    render,
    spread,
    table,
)

from . import points, processes
from .load import Ear, Target, client, unused
from .trial import Refits

RATES = (100.0, 300.0, 1000.0)
"""Arrivals a second."""
REFIT_RATE = 300.0
REFIT_SAMPLES = 2000
GOALS = {100.0: (1.25, 1.5), 300.0: (1.25, 1.5), 1000.0: (2.0, 2.0)}
"""Most that p50 and p99 may be, node / relay, by the rate."""
REFIT_GOAL = 2.0
"""Most that p99 may be during refits."""
INPUTS = "inputs"
POINT = "operating_point"
_OUTPUT_SPEED = 100.0
_CYCLE = 3000
_LAST = 0.3
"""Time after the last arrival in which answers may still come [s]."""


class Stretch(NamedTuple):
    """What one stretch of load showed.

    Attributes:
        sent: arrivals.
        latency: from each arrival that was answered to the last message of its answer [ms].
    """

    sent: int
    latency: NDArray[np.float64]


class Turn(NamedTuple):
    """A stretch of the node, then one of the relay; the count is of what the node has lost."""

    node: Stretch
    relay: Stretch
    lost: int


class Asker:
    """Sends messages on `operating_point` and hears the answers on `advice`."""

    def __init__(self, here: Node, process: processes.Process, namespace: str) -> None:
        self._process = process
        self._publisher = here.create_publisher(
            JointState, f"{namespace}/operating_point", qos.INPUT
        )
        self._answers = here.create_subscription(
            JointState, f"{namespace}/advice", unused, 10_000
        )
        self._received: dict[tuple[int, int], int] = {}
        self._ear = Ear(here, {self._answers: self._take})

    def _take(self, message: JointState, received: int) -> None:
        stamp = message.header.stamp
        self._received[stamp.sec, stamp.nanosec] = received

    def wait(self) -> None:
        """Wait until the process answers.

        Raises:
            TimeoutError: it does not.
        """
        sent = _questions(1)[0]
        for _ in range(100):
            self._publisher.publish(sent)
            if self._ear.listen_until(lambda: bool(self._received), 0.2):
                return
        raise TimeoutError(f"no advice:\n{self._process.log}")

    def load(self, rate: float, seconds: float) -> Stretch:
        """Send points at a rate [Hz] for a time [s]."""
        questions = _questions(round(rate * seconds))
        self._ear.listen_for(_LAST)
        self._received.clear()
        sent = {}
        due = time.monotonic()
        for message in questions:
            while (left := due - time.monotonic()) > 0.0:
                self._ear.listen(left)
            stamp = message.header.stamp
            sent[stamp.sec, stamp.nanosec] = time.time_ns()
            self._publisher.publish(message)
            # A load that was held up goes on later; it does not make up for it with a burst.
            due = max(due + 1.0 / rate, time.monotonic())
        self._ear.listen_for(_LAST)
        times = [self._received[stamp] - sent[stamp] for stamp in self._received]
        return Stretch(len(sent), np.array(times) * 1e-6)


def _questions(count: int) -> list[JointState]:
    """Return messages with points of which each has an answer, and a stamp of its own."""
    low, high = np.transpose(points.ORDINARY)
    drawn = np.random.default_rng(0).uniform(low, high, (count, len(low)))
    questions = []
    for number, (stroke, speed, load) in enumerate(drawn.tolist()):
        message = bench_sample_to_message(
            stroke, speed, load, _OUTPUT_SPEED, load * speed / _OUTPUT_SPEED
        )
        message.header.stamp.sec = 1 + number // 1000
        message.header.stamp.nanosec = number % 1000
        questions.append(message)
    return questions


class Trial:
    """The node and the relay under load."""

    def __init__(
        self,
        here: Node,
        node: processes.Process,
        relay: processes.Process,
        seconds: float,
    ) -> None:
        model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
        self._seconds = seconds
        self._node = Target(here, node, "/node")
        self._relay = Target(here, relay, "/relay")
        self._asked = (Asker(here, node, "/node"), Asker(here, relay, "/relay"))
        self._answered = points.answered(model, _CYCLE, 0)
        self._echoed = points.echoed(_CYCLE, 0)
        self._refits = Refits(here, self._node, "/node")
        self._model = model

    def wait(self) -> None:
        """Wait until both are there."""
        for target in (self._node, self._relay):
            target.wait()
        for asker in self._asked:
            asker.wait()

    def turn(self, kind: str, rate: float) -> Turn:
        """Load both, one after the other."""
        lost = self._lost()
        if kind == POINT:
            node, relay = (asker.load(rate, self._seconds) for asker in self._asked)
        else:
            node = self._load(self._node, self._answered, rate)
            relay = self._load(self._relay, self._echoed, rate)
        return Turn(node, relay, self._lost() - lost)

    def refit(self, state: Path) -> None:
        """Let the node refit itself once; it does so again during the next turns."""
        self._refits.log_samples(self._model, REFIT_SAMPLES, 0)
        self._refits.poll()
        served = hmcvt.load_model(state / self._refits.finish()["file"])
        self._answered = points.answered(served, _CYCLE, 0)

    def refitting_turn(self) -> Turn:
        """Load the node while it refits itself, then the relay alone."""
        lost = self._lost()
        node = self._load(self._node, self._answered, REFIT_RATE, self._refits.poll)
        self._refits.finish()
        relay = self._load(self._relay, self._echoed, REFIT_RATE)
        return Turn(node, relay, self._lost() - lost)

    def _load(
        self,
        target: Target,
        cycle: points.Cycle,
        rate: float,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> Stretch:
        segment = target.load(cycle, rate / points.TOPICS, self._seconds, meanwhile)
        return Stretch(segment.sent, segment.optimum_latency)

    def _lost(self) -> int:
        """Return how many arrivals the node says that it has lost."""
        self._node.counts()  # waits for new diagnostics
        return self._node.statuses.sum("inputs", " lost")


def _ratio(turns: list[Turn], percent: float) -> Spread:
    return spread(
        [
            float(
                np.percentile(turn.node.latency, percent)
                / np.percentile(turn.relay.latency, percent)
            )
            for turn in turns
        ]
    )


def _goals(
    found: Mapping[tuple[str, float], list[Turn]], refitting: list[Turn]
) -> list[Goal]:
    goals = []
    for (kind, rate), turns in found.items():
        for percent, most in zip((50, 99), GOALS[rate], strict=True):
            ratio = _ratio(turns, percent)
            goals.append(
                Goal(
                    f"p{percent}, {kind}, {rate:g} arrivals a second",
                    f"at most {most:g}",
                    ratio.text(),
                    ratio.median <= most,
                )
            )
        sent = sum(turn.node.sent for turn in turns)
        lost = sum(turn.lost for turn in turns)
        answered = sum(len(turn.node.latency) for turn in turns)
        goals.append(
            Goal(
                f"answered or counted as lost, {kind}, {rate:g} arrivals a second",
                "all",
                f"{answered} and {lost} of {sent}",
                answered + lost >= sent,
            )
        )
    ratio = _ratio(refitting, 99)
    goals.append(
        Goal(
            f"p99, {INPUTS}, {REFIT_RATE:g} arrivals a second, during refits",
            f"at most {REFIT_GOAL:g}",
            ratio.text(),
            ratio.median <= REFIT_GOAL,
        )
    )
    return goals


def _times(
    found: Mapping[tuple[str, float], list[Turn]],
) -> list[tuple[object, ...]]:
    rows = []
    for (kind, rate), turns in found.items():
        row: list[object] = [kind, f"{rate:g}"]
        for percent in (50, 99):
            for who in ("node", "relay"):
                times = [
                    float(np.percentile(getattr(turn, who).latency, percent))
                    for turn in turns
                ]
                row.append(spread(times).text())
        rows.append(tuple(row))
    return rows


def page(
    command: str,
    others: float,
    found: Mapping[tuple[str, float], list[Turn]],
    refitting: list[Turn],
) -> str:
    """Return docs/studies/latency.md."""
    head = (
        "",
        "arrivals a second",
        "p50 node",
        "p50 relay",
        "p99 node",
        "p99 relay",
    )
    return render(
        "latency.md.j2",
        Path(__file__).parent,
        command=command,
        machine=machine(),
        others=others,
        goals=goal_table(_goals(found, refitting)),
        times=table(head, _times(found)),
    )


@click.command(help=__doc__)
@click.option("--turns", default=5, show_default=True)
@click.option("--seconds", default=5.0, show_default=True)
@click.option("--out", type=click.Path(path_type=Path))
def main(turns: int, seconds: float, out: Path | None) -> None:
    """Run the turns and print or write the page."""
    found: dict[tuple[str, float], list[Turn]] = {
        (kind, rate): [] for kind in (INPUTS, POINT) for rate in RATES
    }
    refitting = []
    with tempfile.TemporaryDirectory(prefix="hmcvt-latency-") as name:
        folder = Path(name)
        processes.loopback_only(folder)
        others = busy_cores()
        with (
            client() as here,
            processes.node("/node", folder) as node,
            processes.relay("/relay", folder) as relay,
        ):
            trial = Trial(here, node, relay, seconds)
            trial.wait()
            for _ in range(turns):
                for (kind, rate), stretches in found.items():
                    stretches.append(trial.turn(kind, rate))
            trial.refit(folder / "node")
            for _ in range(turns):
                refitting.append(trial.refitting_turn())
    command = "python -m studies.soak.latency"
    if (turns, seconds) != (5, 5.0):
        command = f"{command} --turns {turns} --seconds {seconds:g}"
    if out is not None:
        command = f"{command} --out {out}"
    text = page(command, others, found, refitting)
    if out is None:
        print(text)
    else:
        out.write_text(text)


if __name__ == "__main__":
    main()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""docs/studies/soak.md."""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np

from studies.page import Goal, Run, Spread, goal_table, machine, render, spread, table

from .load import Segment
from .points import TOPICS
from .trial import Fuzzed, Loaded, Plan, Turn

MEGABYTE = 1e6
MEMORY_GOAL = 0.1  # MB a minute: two bytes for each arrival at 300 Hz
CEILING_GOAL = 1000.0
STEADY_GOALS = {50: 1.25, 99: 1.5}  # percentile of the latency: node / relay
Figure = Callable[[Segment], float]
Process = CompletedProcess[str]


def goals(loaded: Loaded, fuzzed: Fuzzed, kills: Process, plan: Plan) -> list[Goal]:
    """Return what was aimed at and what was reached; `kills` is the run of `kill_trials`."""
    steady, refitting = (_parts(turns) for turns in (loaded.steady, loaded.refitting))
    slope = _memory_slope(steady[0])
    top = _ceiling(loaded.rising, 1.0)
    return [
        *(
            _ratio_goal(
                f"p{percent}, {plan.rate:g} Hz on each input",
                ratio(latency(percent), *steady),
                most,
            )
            for percent, most in STEADY_GOALS.items()
        ),
        _ratio_goal(
            "p99 during refits; the relay alone", ratio(latency(99), *refitting), 2.0
        ),
        *_arrival_goals(f"{plan.rate:g} Hz", loaded.steady),
        *_arrival_goals("during refits", loaded.refitting),
        Goal(
            "growth of memory under load",
            f"at most {MEMORY_GOAL} MB a minute",
            f"{slope:+.3f} MB a minute",
            slope <= MEMORY_GOAL,
        ),
        Goal(
            "highest rate of each input with every arrival answered",
            f"{CEILING_GOAL:g} Hz",
            f"{top:.0f} Hz",
            top >= CEILING_GOAL,
        ),
        Goal(
            f"{fuzzed.sent} invalid messages: wrong or missing answers, wrong counts",
            "0",
            str(len(fuzzed.differences)),
            not fuzzed.differences,
        ),
        Goal(
            "the node survives them and ends with code 0",
            "yes",
            "yes" if fuzzed.survived and fuzzed.exit_code == 0 else "no",
            fuzzed.survived and fuzzed.exit_code == 0,
        ),
        Goal(
            "nothing is lost or damaged by a kill",
            "yes",
            "no" if kills.returncode else "yes",
            not kills.returncode,
        ),
    ]


def text(
    run: Run,
    plan: Plan,
    loaded: Loaded,
    fuzzed: Fuzzed,
    kills: Process,
    edits: str = "",
    faults: str = "",
) -> str:
    """Return the document.

    Args:
        run: how the trials were run.
        plan: what was planned.
        loaded: trials under load.
        fuzzed: trial with invalid messages.
        kills: run of `kill_trials`.
        edits: output of `edit_log`.
        faults: table of `faults`.
    """
    both = (("node", loaded.rising), ("relay", loaded.rising_relay))
    return render(
        "report.md.j2",
        Path(__file__).parent,
        run=run,
        plan=plan,
        loaded=loaded,
        fuzzed=fuzzed,
        kills=kills,
        edits=edits,
        faults=faults,
        machine=machine(),
        rclpy=version("ros-rclpy"),
        goals=goal_table(goals(loaded, fuzzed, kills, plan)),
        times=_time_table(loaded),
        ceilings=table(
            ("", "every arrival answered up to", "99 % answered up to"),
            [
                [
                    name,
                    *(f"{_ceiling(segments, share):.0f} Hz" for share in (1.0, 0.99)),
                ]
                for name, segments in both
            ],
        ),
        limits=[
            (name, segments[-1], _kept_up(segments[-1])) for name, segments in both
        ],
        memory=[f"{size / MEGABYTE:.1f}" for size in loaded.memory],
    )


# --- tables ---------------------------------------------------------------------------------------


def _time_table(loaded: Loaded) -> str:
    (node, relay), (busy, quiet) = _parts(loaded.steady), _parts(loaded.refitting)
    rows = [
        ("node, steady", node),
        ("relay, steady", relay),
        ("node, during refits", busy),
        ("relay, quiet turns between", quiet),
    ]
    figures = (
        latency(50, "efficiency"),
        latency(99, "efficiency"),
        latency(50),
        latency(99),
        latency(100),
        lambda segment: segment.cpu,
    )
    head = (
        "",
        "first answer p50",
        "p99",
        "both answers p50",
        "p99",
        "longest",
        "processor",
    )
    return table(
        head,
        [
            [
                name,
                *(
                    spread([figure(segment) for segment in segments]).text()
                    for figure in figures
                ),
            ]
            for name, segments in rows
        ],
    )


# --- helpers --------------------------------------------------------------------------------------


def _parts(turns: Sequence[Turn]) -> tuple[list[Segment], list[Segment]]:
    return [turn.node for turn in turns], [turn.relay for turn in turns]


def _ratio_goal(what: str, found: Spread, limit: float) -> Goal:
    return Goal(
        f"{what}: node / relay",
        f"at most {limit:g}",
        found.text(),
        found.median <= limit,
    )


def _arrival_goals(when: str, turns: Sequence[Turn]) -> list[Goal]:
    segments = [turn.node for turn in turns]
    sent = sum(segment.sent for segment in segments)
    heard = sum(turn.node.accepted for turn in turns)
    right = sum(segment.right for segment in segments)
    return [
        Goal(
            f"arrivals heard, of those sent, {when}",
            "all",
            f"{heard} of {sent}",
            heard == sent,
        ),
        Goal(
            f"correct answers, of the arrivals heard, {when}",
            "all",
            f"{right} of {heard}",
            right == heard,
        ),
    ]


def latency(percentile: float, outputs: str = "optimum") -> Figure:
    """Return what gives the latency of the whole answer, both outputs, or of the first [ms]."""
    return lambda segment: float(
        np.percentile(getattr(segment, f"{outputs}_latency"), percentile)
    )


def ratio(figure: Figure, above: Sequence[Segment], below: Sequence[Segment]) -> Spread:
    """Return the ratio of the medians of two sets of stretches, with the range turn by turn."""
    over, under = (
        [figure(segment) for segment in segments] for segments in (above, below)
    )
    by_turn = [one / other for one, other in zip(over, under, strict=True)]
    return Spread(float(np.median(over) / np.median(under)), min(by_turn), max(by_turn))


def _memory_slope(segments: Sequence[Segment]) -> float:
    """How fast the memory grows under load [MB a minute], the first stretch left out."""
    memory = np.concatenate([segment.memory for segment in segments[1:]]) / MEGABYTE
    seconds = sum(segment.seconds for segment in segments[1:])
    minutes = np.linspace(0.0, seconds / 60.0, len(memory))
    return float(np.polyfit(minutes, memory, 1)[0])


def _kept_up(segment: Segment) -> bool:
    """Whether the generator sent at the rate aimed at."""
    return segment.sent / segment.seconds >= 0.95 * TOPICS * segment.rate


def _ceiling(segments: Sequence[Segment], share: float) -> float:
    """The highest rate [Hz] that was sent and of which this share was answered, or 0."""
    return max(
        (
            segment.rate
            for segment in segments
            if _kept_up(segment) and segment.answers >= share * segment.sent
        ),
        default=0.0,
    )

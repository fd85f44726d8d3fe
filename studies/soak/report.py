# SPDX-License-Identifier: Apache-2.0
"""docs/soak.md."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from studies.page import Goal, Run, Spread, goal_table, machine, spread, table

from .load import Segment
from .points import TOPICS
from .trial import Fuzzed, Loaded, Plan, Turn

MEGABYTE = 1e6
MEMORY_GOAL = 0.1  # MB a minute: two bytes for each arrival at 300 Hz
CEILING_GOAL = 1000.0
Figure = Callable[[Segment], float]


@dataclass(frozen=True)
class Kills:
    """What the trials that kill the node printed, and whether they found nothing wrong."""

    text: str
    good: bool


def goals(loaded: Loaded, fuzzed: Fuzzed, kills: Kills, plan: Plan) -> list[Goal]:
    """Return what was aimed at and what was reached."""
    steady, refitting = (_parts(turns) for turns in (loaded.steady, loaded.refitting))
    slope = _memory_slope(steady[0])
    top = _ceiling(loaded.rising, 1.0)
    return [
        _ratio_goal(f"p99, {plan.rate:g} Hz on each input", ratio(latency(99), *steady), 1.5),
        _ratio_goal("p99 during refits; the relay alone", ratio(latency(99), *refitting), 2.0),
        *_arrival_goals(f"{plan.rate:g} Hz", loaded.steady),
        *_arrival_goals("during refits", loaded.refitting),
        Goal("growth of memory under load", f"at most {MEMORY_GOAL} MB a minute",
             f"{slope:+.3f} MB a minute", slope <= MEMORY_GOAL),
        Goal("highest rate of each input with every arrival answered",
             f"{CEILING_GOAL:g} Hz", f"{top:.0f} Hz", top >= CEILING_GOAL),
        Goal(f"{fuzzed.sent} messages of nonsense: wrong or missing answers, wrong counts", "0",
             str(len(fuzzed.differences)), not fuzzed.differences),
        Goal("the node survives them and ends with code 0", "yes",
             "yes" if fuzzed.survived and fuzzed.exit_code == 0 else "no",
             fuzzed.survived and fuzzed.exit_code == 0),
        Goal("nothing is lost or damaged by a kill", "yes", "yes" if kills.good else "no",
             kills.good),
    ]


def text(run: Run, plan: Plan, loaded: Loaded, fuzzed: Fuzzed, kills: Kills) -> str:
    """Return the document."""
    return "\n".join([
        "# Endurance trial", "",
        f"Written by `make soak` (`{run.command}`) in {run.seconds / 60:.1f} minutes.", "",
        f"Machine: {machine()}; rclpy {version('ros-rclpy')} with Fast DDS on the "
        f"loopback interface. Other programs used {run.others:.2f} cores before the start.", "",
        *goal_table(goals(loaded, fuzzed, kills, plan)), "",
        *_ratio_table(loaded), "",
        *_time_table(loaded), "",
        *_count_table(loaded), "",
        *_rate_table(loaded), "",
        *_memory(loaded), "",
        *_fuzz(fuzzed), "",
        "## Kills", "", kills.text.strip(), "",
        *_method(plan, loaded), ""])


# --- parts ----------------------------------------------------------------------------------------


def _ratio_table(loaded: Loaded) -> list[str]:
    rows = [("steady", *_parts(loaded.steady)), ("during refits", *_parts(loaded.refitting)),
            ("during refits, the relay beside them", *_beside(loaded.refitting))]
    return ["## Ratios to a bare relay", "",
            "Time from an arrival to the last of its two answers, node / relay: median of the "
            "stretches, and lowest to highest turn.", "",
            *table(("", "p50", "p99", "longest"), [
                [name, *(ratio(latency(percent), node, relay).text() for percent in (50, 99, 100))]
                for name, node, relay in rows])]


def _time_table(loaded: Loaded) -> list[str]:
    (node, relay), (busy, quiet) = _parts(loaded.steady), _parts(loaded.refitting)
    rows = [("node, steady", node), ("relay, steady", relay), ("node, during refits", busy),
            ("relay, quiet turns between", quiet),
            ("relay, beside refits", _beside(loaded.refitting)[1])]
    figures = (_first_latency(50), _first_latency(99), latency(50), latency(99), latency(100),
               lambda segment: segment.cpu)
    return ["## Times", "",
            "Milliseconds, median of the stretches and lowest to highest; processor time as a "
            "share of one core.", "",
            *table(("", "first answer p50", "p99", "both answers p50", "p99", "longest",
                    "processor"), [
                [name, *(spread([figure(segment) for segment in segments]).text()
                         for figure in figures)] for name, segments in rows])]


def _count_table(loaded: Loaded) -> list[str]:
    rows = []
    for name, turns in (("steady", loaded.steady), ("during refits", loaded.refitting)):
        parts = [(turn.node.segment.sent, turn.node.accepted, turn.node.answered,
                  turn.node.segment.answers, turn.node.segment.optima, turn.node.segment.right,
                  turn.node.segment.repeats) for turn in turns]
        rows.append([name, *(str(sum(counts)) for counts in zip(*parts, strict=True))])
    return ["## Counts", "",
            "What was sent and what came back are counted by the load generator, arrivals heard "
            "and points answered by the node. An answer is right when both outputs are, bit by "
            "bit, what the model gives; repeated answers come with a new model.", "",
            *table(("", "sent", "heard", "answered", "`efficiency`",
                    "`optimal_displacement_ratio`", "right", "repeated"), rows)]


def _rate_table(loaded: Loaded) -> list[str]:
    both = (("node", loaded.rising), ("relay", loaded.rising_relay))
    return ["## Rising rate", "",
            "Inputs are best effort with depth 5: what is not taken in time is lost.", "",
            *table(("", "Hz on each input", "reached", "sent", "answered", "processor",
                    "generator", "others"), [
                [name, f"{part.rate:.0f}", f"{part.sent / part.seconds / TOPICS:.0f}",
                 str(part.sent), _share(part.answers, part.sent), f"{part.cpu:.2f}",
                 f"{part.generator_cpu:.2f}", f"{part.other_cpu:.2f}"]
                for name, segments in both for part in segments]), "",
            *table(("", "every arrival answered up to", "99 % answered up to"), [
                [name, *(f"{_ceiling(segments, share):.0f} Hz" for share in (1.0, 0.99))]
                for name, segments in both]), "",
            *(_limit(segments, name) for name, segments in both)]


def _limit(segments: Sequence[Segment], name: str) -> str:
    """Say what the last stretch of a rising rate was limited by."""
    last = segments[-1]
    said = (f"In its last stretch the {name} used {last.cpu:.2f} of a core and the load generator "
            f"{last.generator_cpu:.2f}")
    if not _kept_up(last):
        return f"{said}; the generator fell behind, so that it and not the {name} may be the limit."
    return f"{said}, which kept up: it is not the limit."


def _memory(loaded: Loaded) -> list[str]:
    start, *rest = (size / MEGABYTE for size in loaded.memory)
    named = zip(("the steady load", "the rising rate", "the refits"), rest, strict=True)
    return ["## Memory", "", f"The node held {start:.1f} MB (RSS) at the start, "
            + ", ".join(f"{size:.1f} MB after {name}" for name, size in named) + "."]


def _fuzz(fuzzed: Fuzzed) -> list[str]:
    lines = ["## Nonsense", "",
             f"{fuzzed.sent} messages in {fuzzed.seconds:.0f} s: NaN, infinities, denormal "
             "numbers, negative zero, arbitrary bits, the limits and their neighbours; bench "
             "samples with wrong, doubled and missing joints, arrays that are empty or unequal, "
             "bad numbers and stamps; good ones in between.",
             f"{fuzzed.answers} answers on `efficiency` were due and each was compared with the "
             f"model, as were the counts in `/diagnostics`; {fuzzed.logged} bench samples were due "
             "in the log."]
    return lines + [f"- {difference}" for difference in fuzzed.differences]


def _method(plan: Plan, loaded: Loaded) -> list[str]:
    slip = max(abs(segment.clock_slip) for turns in (loaded.steady, loaded.refitting)
               for segment in (*_parts(turns)[0], *_parts(turns)[1]))
    return [
        "## How it is measured", "",
        "- Node, relay and load generator are processes of their own. The relay "
        "(`studies/soak/relay.py`) has inputs, outputs, qualities of service and executor of the "
        "node and publishes every value twice.",
        f"- Node and relay take turns of {plan.seconds:g} s, {plan.turns} each, and "
        f"{plan.refit_turns} each during refits, so that noise of the machine meets both.",
        "- Arrivals go to one topic after the other at even distances. Each makes a point with an "
        "efficiency of its own, by which its answer is recognised; every answer is compared bit by "
        "bit with the model on both outputs.",
        "- A time runs from before `publish` here to the stamp with which the middleware here "
        f"receives the answer. The system clock slipped by at most {slip * 1e6:.0f} us in a turn.",
        "- Arrivals heard and answered are the counts of the node in `/diagnostics`; sent and "
        "answers are counted here.",
        f"- During refits `~/reidentify` runs all the time, on {plan.samples} samples "
        f"({loaded.refits[1]:.1f} s alone, {loaded.refits[0]} in all), in a process beside the "
        "node; a new model answers the inputs as they stand once more.",
    ]


# --- helpers --------------------------------------------------------------------------------------


def _parts(turns: Sequence[Turn]) -> tuple[list[Segment], list[Segment]]:
    return [turn.node.segment for turn in turns], [turn.relay for turn in turns]


def _beside(turns: Sequence[Turn]) -> tuple[list[Segment], list[Segment]]:
    return _parts(turns)[0], [turn.relay_beside for turn in turns if turn.relay_beside]


def _ratio_goal(what: str, found: Spread, limit: float) -> Goal:
    return Goal(f"{what}: node / relay", f"at most {limit:g}", found.text(), found.median <= limit)


def _arrival_goals(when: str, turns: Sequence[Turn]) -> list[Goal]:
    segments = [turn.node.segment for turn in turns]
    sent = sum(segment.sent for segment in segments)
    heard = sum(turn.node.accepted for turn in turns)
    right = sum(segment.right for segment in segments)
    return [
        Goal(f"arrivals heard, of those sent, {when}", "all", f"{heard} of {sent}", heard == sent),
        Goal(f"arrivals answered rightly, of those heard, {when}", "all", f"{right} of {heard}",
             right == heard)]


def _share(part: int, whole: int) -> str:
    return "all" if part == whole else f"{100 * part / whole:.2f} %"


def latency(percentile: float) -> Figure:
    """Return what gives the latency of the whole answer, both outputs [ms]."""
    return lambda segment: float(np.percentile(segment.optimum_latency, percentile))


def _first_latency(percentile: float) -> Figure:
    return lambda segment: float(np.percentile(segment.efficiency_latency, percentile))


def ratio(figure: Figure, above: Sequence[Segment], below: Sequence[Segment]) -> Spread:
    """Return the ratio of the medians of two sets of stretches, with the range turn by turn."""
    over, under = ([figure(segment) for segment in segments] for segments in (above, below))
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
    return max((segment.rate for segment in segments
                if _kept_up(segment) and segment.answers >= share * segment.sent), default=0.0)

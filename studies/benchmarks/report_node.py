# SPDX-License-Identifier: Apache-2.0
"""The part of docs/benchmarks.md on the node."""

from __future__ import annotations

from studies.soak.goals import Goal, table

from . import bench_node
from .limits import at_most
from .record import Entry, Figure, Record, Spread, short

NODE, RELAY = ({"contender": name} for name in bench_node.CONTENDERS)
CORE, BARE, MODULE, ROS = (
    {"modules": name} for name in ("hmcvt_core", bench_node.BARE, "hmcvt_ros.efficiency_node",
                                   f"{bench_node.MESSAGES}, {bench_node.BARE}"))


def goals(record: Record) -> list[Goal]:
    """Return the goals."""
    heavy = sorted({name for which in (CORE, MODULE)
                    for entry in record.select("bench_import", **which)
                    for name in entry.told["heavy"]})
    return [
        at_most("node / relay: arrival to both answers, p50", _load(record, "p50"), 1.15),
        Goal("optimisers, plots, command line among the imports of library and node", "none",
             ", ".join(heavy) or "none", not heavy),
    ]


def section(record: Record) -> list[str]:
    """Return the section."""
    node, relay = (record.spread("bench_load", _told("p50"), **which).median
                   for which in (NODE, RELAY))
    sent, right = (sum(entry.told[name] for entry in record.select("bench_load", **NODE))
                   for name in ("sent", "right"))
    return [
        "## The node", "",
        *table(("", "ratio"), [
            *([f"arrival to both answers, {percentile}: node / relay",
               _load(record, percentile).text()] for percentile in ("p50", "p99")),
            ["processor time per arrival: node / relay", _load(record, "cpu").text()],
            ["from the command to the first answer: node / relay",
             record.ratio("bench_start", NODE, RELAY).text()],
            ["processor time of that: node / relay",
             record.ratio("bench_start", NODE, RELAY, _told("cpu")).text()],
            ["`import hmcvt_core` / `import numpy`", _import(record, CORE, BARE).text()],
            ["`import hmcvt_ros.efficiency_node` / import of rclpy, its messages and NumPy",
             _import(record, MODULE, ROS).text()]]), "",
        f"- Load: {bench_node.RATE:g} Hz on each of the three inputs, "
        f"{record.one('bench_load').told['seconds']:g} s a "
        f"turn; {right} of {sent} arrivals at the node were answered rightly, on both outputs. "
        f"p50 of the node {short(node)} ms, of the relay {short(relay)} ms.",
        "- The relay (`studies/soak/relay.py`) has the same inputs, outputs and executor and "
        "publishes what it hears twice; load generator and clock are those of `make soak`.",
        f"- The first answer comes {_seconds(record, NODE)} s after the command of the node, "
        f"{_seconds(record, RELAY)} s after that of the relay.",
        f"- The imports leave out {', '.join(f'`{name}`' for name in bench_node.HEAVY)}.",
    ]


def _told(name: str) -> Figure:
    return lambda entry: entry.told[name]


def _load(record: Record, name: str) -> Spread:
    return record.ratio("bench_load", NODE, RELAY, _told(name))


def _import(record: Record, over: dict[str, str], under: dict[str, str]) -> Spread:
    return record.ratio("bench_import", over, under, _told("seconds"))


def _seconds(record: Record, which: dict[str, str]) -> str:
    return short(record.spread("bench_start", Entry.per_call, **which).median)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node beside a bare relay: time from an arrival to the last of its two answers."""

from __future__ import annotations

from pathlib import Path

import hmcvt_core as hmcvt
from studies.page import spread, table

from .timing import Section, at_most, ratio

TURNS = 8
RATE = 300.0  # Hz on each input
ARRIVALS = 3000
LIMIT = 1.5  # times the relay


def section(model: hmcvt.EfficiencyModel, folder: Path, quick: bool) -> Section:
    """Load both in turns."""
    from studies.soak import load, points, processes, report

    processes.loopback_only(folder)
    seconds = 1.0 if quick else 3.0
    with (load.client() as client, processes.node("/loaded_node", folder) as node,
          processes.relay("/loaded_relay", folder) as relay):
        under = [(load.Target(client, node, "/loaded_node"),
                  points.answered(model, ARRIVALS, seed=0)),
                 (load.Target(client, relay, "/loaded_relay"), points.echoed(ARRIVALS, seed=0))]
        for target, _ in under:
            target.wait()
        turns = [[target.load(cycle, RATE, seconds) for target, cycle in under]
                 for _ in range(2 if quick else TURNS)]
    for segment in (segment for turn in turns for segment in turn):
        # Inputs are best effort: a busy machine loses some, but no answer may be wrong.
        assert segment.right == segment.answers > 0.5 * segment.sent

    columns = [{name: list(map(report.latency(percent), segments))
                for name, segments in zip(("node", "relay"), zip(*turns, strict=True), strict=True)}
               for percent in (50, 99)]
    ratios = [ratio(times, "node", "relay") for times in columns]
    rows = [*([name, *(spread(times[name]).text(".2g") for times in columns)]
              for name in ("node", "relay")),
            ["node / relay", *(found.text() for found in ratios)]]
    return Section([at_most("arrival to both answers, p50: node / relay", ratios[0], LIMIT)], {
        "rate": RATE, "seconds": seconds, "latencies": table(("", "p50", "p99"), rows)})

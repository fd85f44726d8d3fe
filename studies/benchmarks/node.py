# SPDX-License-Identifier: Apache-2.0
"""The node beside a bare relay: time from an arrival to the last of its two answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import hmcvt_core as hmcvt
from studies.page import Spread, spread, table

from .timing import Section, at_most

TURNS = 8
RATE = 300.0  # Hz on each input
ARRIVALS = 3000
LIMIT = 1.5  # times the relay


def section(model: hmcvt.EfficiencyModel, folder: Path, quick: bool) -> Section:
    """Load both in turns."""
    from studies.soak import load, points, processes

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

    def latency(percent: float, which: int) -> list[float]:
        return [float(np.percentile(turn[which].optimum_latency, percent)) for turn in turns]

    def to_relay(percent: float) -> Spread:
        return spread([one / other for one, other in
                       zip(latency(percent, 0), latency(percent, 1), strict=True)])

    rows = [[name, *(spread(latency(percent, which)).text(".2g") for percent in (50, 99))]
            for which, name in enumerate(("node", "relay"))]
    rows.append(["node / relay", *(to_relay(percent).text() for percent in (50, 99))])
    return Section([at_most("arrival to both answers, p50: node / relay", to_relay(50), LIMIT)], {
        "rate": RATE, "seconds": seconds, "latencies": table(("", "p50", "p99"), rows)})

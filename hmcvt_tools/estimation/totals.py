# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Energies, fuel, hours by stage and the map of operating points, added up row by row."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hmcvt_core.transmission.ranges import RPM, Array

from .solving import QUANTILE

STROKE_WIDTH = 0.2
SPEED_WIDTH = 100.0 * RPM
"""Width of a cell of the map [rad/s]: 100 r/min."""
TORQUE_WIDTH = 50.0
"""Width of a cell of the map [N m]."""

Cell = tuple[str, int, int, int]
"""Stage, and number of the cell along displacement ratio, engine speed and load torque."""


@dataclass
class Totals:
    """Sums over a log, or over several.

    Attributes:
        seconds: with a known engine speed.
        estimated: with an estimate.
        engine: energy from the engine [J], over the seconds estimated; so are the next two.
        output: energy to the output.
        lost: energy lost in the transmission.
        output_deviations: of `output` by lasting source, with their sign [J].
        passing_variance: of `output` by all other sources [J2].
        fuel: [kg], over all seconds.
        fuel_lost: fuel for what the transmission lost [kg].
        stages: seconds by stage.
        cells: seconds, output energy and lost energy by cell of the map.
        without: seconds without an estimate by reason.
    """

    seconds: float = 0.0
    estimated: float = 0.0
    engine: float = 0.0
    output: float = 0.0
    lost: float = 0.0
    output_deviations: Array = field(default_factory=lambda: np.zeros(0))
    passing_variance: float = 0.0
    fuel: float = 0.0
    fuel_lost: float = 0.0
    stages: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    cells: dict[Cell, Array] = field(default_factory=dict)
    without: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, other: Totals) -> None:
        """Add the sums of another log."""
        for name in ("seconds", "estimated", "engine", "output", "lost", "fuel"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.fuel_lost += other.fuel_lost
        self.passing_variance += other.passing_variance
        self.add_deviations(other.output_deviations)
        for name, seconds in other.stages.items():
            self.stages[name] += seconds
        for name, seconds in other.without.items():
            self.without[name] += seconds
        for cell, sums in other.cells.items():
            self.cells[cell] = self.cells.get(cell, np.zeros(3)) + sums

    def add_deviations(self, sums: Array) -> None:
        """Add sums of lasting deviations, which are the same sources in every log."""
        if not len(self.output_deviations):
            self.output_deviations = np.zeros(len(sums))
        if len(sums):
            self.output_deviations = self.output_deviations + sums

    def add_cells(
        self,
        stage: Array,
        points: tuple[Array, Array, Array],
        sums: Array,
        names: Mapping[int, str],
    ) -> None:
        """Add rows to the map.

        Args:
            stage: by number, shape (n,).
            points: displacement ratio, engine speed and load torque, shape (n,) each.
            sums: seconds, output energy and lost energy, shape (3, n).
            names: of the stages by number.
        """
        widths = (STROKE_WIDTH, SPEED_WIDTH, TORQUE_WIDTH)
        numbers = [np.floor(c / w + 1e-9) for c, w in zip(points, widths, strict=True)]
        keys = np.stack([stage, *numbers]).astype(np.int64)
        # One whole number for each cell, so that the sums are those of a bincount.
        low = keys.min(axis=1, keepdims=True)
        shape = (keys - low).max(axis=1) + 1
        flat = np.ravel_multi_index(tuple(keys - low), tuple(shape))
        cells, index = np.unique(flat, return_inverse=True)
        added = np.stack([np.bincount(index, row, len(cells)) for row in sums], axis=1)
        positions = (
            np.stack(np.unravel_index(cells, tuple(shape)), axis=1) + low.ravel()
        )
        for position, total in zip(positions.tolist(), added, strict=True):
            cell = (names[position[0]], *position[1:])
            self.cells[cell] = self.cells.get(cell, np.zeros(3)) + total

    @property
    def output_interval(self) -> tuple[float, float]:
        """Interval of `output` at 90 % [J]."""
        variance = float((self.output_deviations**2).sum()) + self.passing_variance
        half = QUANTILE * float(np.sqrt(variance))
        return self.output - half, self.output + half

    @property
    def coverage(self) -> float:
        """Fraction of the seconds with an estimate."""
        return self.estimated / self.seconds if self.seconds else 0.0

    def map_rows(self) -> list[dict[str, Any]]:
        """Return the map of operating points: middle of each cell, seconds, weight, energies."""
        rows = []
        total = sum(float(sums[0]) for sums in self.cells.values())
        for cell in sorted(self.cells):
            stage, stroke, speed, torque = cell
            seconds, output, lost = self.cells[cell].tolist()
            rows.append(
                {
                    "stage": stage,
                    "displacement_ratio": _middle(stroke, STROKE_WIDTH),
                    "engine_speed": _middle(speed, SPEED_WIDTH),
                    "load_torque": _middle(torque, TORQUE_WIDTH),
                    "seconds": seconds,
                    "weight": seconds / total if total else 0.0,
                    "output_energy": output,
                    "lost_energy": lost,
                }
            )
        return rows


def _middle(number: int, width: float) -> float:
    return round((number + 0.5) * width, 6)

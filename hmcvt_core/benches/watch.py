# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A sensor on the gap: measured less predicted efficiency, sample by sample as they come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..diagnosis.change import ChangeTest, step_size
from ..files.bench import BenchSamples
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY, PARAMETER_NAMES
from ..transmission.ranges import EFFICIENCY_STD, ENGINE_SPEED_LIMITS
from .transmission import EFFICIENCY_CHANNEL

Array = NDArray[np.float64]
FALSE_ALARMS = 0.01
"""Chance of a false alarm over a whole stream, however long."""
_QUANTILE = 1.96
_PLANE = 4  # its level and three slopes
_SIZED = 4000  # samples, the last, that tell the size
_LOAD = 200.0  # N m: in the middle of the paper's tests


@dataclass(frozen=True)
class Opening:
    """What a watch says.

    Attributes:
        samples: watched.
        without_answer: samples where the model has none; they are left out.
        false_alarms: chance that a stream without a gap, however long, ever raises an alarm.
        noise: where the deviation of the efficiency comes from.
        open: whether a gap has opened.
        noticed: number of the sample that raised the alarm, from 1; None without one.
        since: first sample with the gap, most likely; `since_interval` holds it at 95 %.
        since_stamp: its time [s], None where the samples do not tell.
        size: mean gap since then, measured less predicted efficiency [-]; `interval` at 95 %.
    """

    samples: int
    without_answer: int
    false_alarms: float
    noise: str
    open: bool
    noticed: int | None = None
    since: int | None = None
    since_interval: tuple[int, int] | None = None
    since_stamp: float | None = None
    size: float | None = None
    interval: tuple[float, float] | None = None

    def __str__(self) -> str:
        if self.size is None or self.interval is None or self.since_interval is None:
            return (f"no gap has opened in {self.samples} samples (a false alarm comes in at most "
                    f"{100 * self.false_alarms:g} % of all streams, however long)")
        low, high = sorted(100.0 * abs(end) for end in self.interval)
        if self.interval[0] < 0.0 < self.interval[1]:
            low = 0.0
        first, last = self.since_interval
        return (f"a gap has opened: the bench reads {100 * abs(self.size):.2f} points "
                f"{'below' if self.size < 0.0 else 'above'} the model (95 %: {low:.2f} to "
                f"{high:.2f}), since sample {self.since} (95 %: {first} to {last}), noticed at "
                f"sample {self.noticed}")


class Watch:
    """Compares bench samples with a model as they come; it changes nothing.

    What the model does not know of itself is no gap: its parameters may be off as their standard
    errors say, and its efficiency by a plane over stroke, engine speed and load, each part of the
    deviation by which a form is a little off (as in a diagnosis), or, where a model states no
    errors, of the paper's 1.12 %.
    """

    def __init__(
        self, model: EfficiencyModel, noise: float | None = None,
        false_alarms: float = FALSE_ALARMS,
    ) -> None:
        """Begin with a model.

        Args:
            model: in service; of several stages where the samples name theirs.
            noise: standard deviation of the efficiency [-]; None takes `efficiency_std`, else the
                paper's 1.12 % of the efficiency.
            false_alarms: chance over a whole stream.

        Raises:
            InputError: the noise is out of range.
        """
        self._noise = None if noise is None else float(EFFICIENCY_STD.check(noise, "noise"))
        self.model, self._false_alarms = model, false_alarms
        errors, known = model.standard_errors, model.correlation
        spread = EFFICIENCY_CHANNEL.misfit_spread
        if not errors or known is None:
            spread, errors, known = PAPER_EFFICIENCY_UNCERTAINTY, {}, np.empty((0, 0))
        base = model.parameters.to_array()
        self._errors = np.array([errors[name] for name in PARAMETER_NAMES if errors])
        # A step of a thousandth of the error stays in the linear range.
        self._steps = np.maximum(1e-3 * self._errors, 1e-6 * base[:len(known)] + 1e-18)
        self._values = np.vstack([base, base + np.diag(self._steps)] if errors else [base])
        self._prior = np.eye(_PLANE + len(known)) * spread**2
        self._prior[_PLANE:, _PLANE:] = known
        self._test = ChangeTest(self._prior, EFFICIENCY_CHANNEL.field_spreads)
        self._rows: list[Array] = []  # residual, deviation, stamp, slopes
        self._numbers: list[int] = []  # of the samples with an answer, among all
        self._taken, self._noticed, self._source = 0, 0, "assumed, 1.12 % (paper, eq. (3))"

    def take(self, samples: BenchSamples) -> None:
        """Take samples in the order in which they were measured.

        Raises:
            InputError: a sample names a stage that the model does not have.
        """
        for row in self._compared(samples):
            self._taken += 1
            if not np.isfinite(row).all():
                continue
            self._rows.append(row)
            self._numbers.append(self._taken)
            self._test.take(row[0], row[1], row[3:])
            if not self._noticed and self._test.evidence >= -np.log(self._false_alarms):
                self._noticed = self._taken

    def _compared(self, samples: BenchSamples) -> Array:
        model, points = self.model, samples.points
        here, *there = model.efficiency_of_candidates(self._values, points)
        deviation = PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency
        if self._noise is not None:
            deviation, self._source = np.full(len(samples), self._noise), "as stated"
        elif samples.efficiency_std is not None:
            deviation, self._source = samples.efficiency_std, "column efficiency_std"
        stamp = np.zeros(len(samples)) if samples.stamp is None else samples.stamp
        middle, half = np.mean(ENGINE_SPEED_LIMITS), np.ptp(ENGINE_SPEED_LIMITS) / 2.0
        slopes = [np.ones(len(samples)), points.displacement_ratio,
                  (points.engine_speed - middle) / half,
                  points.load_torque / _LOAD - 1.0]
        slopes += [(near - here) / step * error for near, step, error in zip(
            there, self._steps, self._errors, strict=True)]
        deviation = np.hypot(deviation, EFFICIENCY_CHANNEL.misfit_spread)
        return np.column_stack([samples.efficiency - here, deviation, stamp, *slopes])

    @property
    def found(self) -> Opening:
        """What can be said now."""
        told: dict[str, Any] = {
            "samples": self._taken, "without_answer": self._taken - len(self._rows),
            "false_alarms": self._false_alarms, "noise": self._source, "open": bool(self._noticed)}
        if not self._noticed:
            return Opening(**told)
        (start, first, last), number = self._test.since(), self._numbers
        rows = np.array(self._rows[-_SIZED:])
        size, deviation = step_size(rows[:, 0], rows[:, 1], rows[:, 3:], self._prior,
                                    start - len(number) + len(rows))
        return Opening(
            **told, noticed=self._noticed, since=number[start - 1],
            since_interval=(number[first - 1], number[last - 1]),
            since_stamp=float(self._rows[start - 1][2]) or None, size=size,
            interval=(size - _QUANTILE * deviation, size + _QUANTILE * deviation))


def watch(
    model: EfficiencyModel, samples: BenchSamples, *, noise: float | None = None,
    false_alarms: float = FALSE_ALARMS,
) -> Opening:
    """Watch samples, by their stamps where they have any; see `Watch`."""
    running = Watch(model, noise, false_alarms)
    running.take(samples if samples.stamp is None
                 else samples.select(np.argsort(samples.stamp, kind="stable")))
    return running.found

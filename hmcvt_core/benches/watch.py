# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A sensor on the gap: measured less predicted efficiency, sample by sample as they come.

Residuals of a model that is right are its noise, and what its base does not know: a linear form of
a few unknowns with a prior, as it follows from the standard errors of an identification. A Kalman
filter over these unknowns takes both out; what is left, the innovations, is independent and of
deviation 1 as long as nothing changes (recursive residuals: Brown, Durbin & Evans 1975). A gap that
opens at sample k adds a known signature to them (Willsky & Jones 1976). The likelihood ratio of
each k, averaged over sizes of either sign, is a martingale of mean 1 where there is no gap, and so
is their sum with weights 1 / (k (k + 1)) (Robbins 1970; Lai 1995 for so many k as are kept).
It ever exceeds 1 / alpha with a chance of at most alpha, however long the stream (Ville 1939).

Innovations count up to 3 deviations, so that one bad sample opens no gap, and the deviation of the
noise is taken as larger than stated where those before scattered more: functions that rise no
faster than their argument keep the inequality (Gaussian concentration; Boucheron, Lugosi & Massart
2013).
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..files.bench import BenchSamples
from ..model.agreement import stage_of_each
from ..model.checks import require_model_and_samples
from ..model.model import EfficiencyModel
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY
from ..transmission.ranges import EFFICIENCY_STD, ENGINE_SPEED_LIMITS, Array
from .transmission import EFFICIENCY_CHANNEL

FALSE_ALARMS = 0.01
"""Chance of a false alarm over a whole stream, however long."""
_QUANTILE = 1.96
_PLANE = 4  # its level and three slopes
_SIZED = 4000  # samples, the last, that tell the size
MOST = 3.0
"""Deviations that one sample counts."""
_KEPT = 400  # openings that are still thought of
_WORTH = 20.0  # samples that the noise stated is worth
_LEVEL = 0.95
_ROUNDS = 20  # of weights, which then stay
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
            return (
                f"no gap has opened in {self.samples} samples (a false alarm comes in at most "
                f"{100 * self.false_alarms:g} % of all streams, however long)"
            )
        low, high = sorted(100.0 * abs(end) for end in self.interval)
        if self.interval[0] < 0.0 < self.interval[1]:
            low = 0.0
        first, last = self.since_interval
        return (
            f"a gap has opened: the bench reads {100 * abs(self.size):.2f} points "
            f"{'below' if self.size < 0.0 else 'above'} the model (95 %: {low:.2f} to "
            f"{high:.2f}), since sample {self.since} (95 %: {first} to {last}), noticed at "
            f"sample {self.noticed}"
        )


class ChangeTest:
    """Running test for a step in the mean of residuals, of either sign.

    Attributes:
        samples: taken so far.
        evidence: logarithm of the sum of the weighted likelihood ratios, the largest so far.
    """

    def __init__(self, prior: Array, spreads: Sequence[float]) -> None:
        """Begin with the covariance (p, p) of what is not known of the base.

        Args:
            prior: of the unknowns whose rows `take` is given.
            spreads: of a gap's size, in units of the residuals; equally likely.
        """
        self.samples, self.evidence = 0, -np.inf
        self._squares: float = _WORTH  # of innovations, in units of the noise stated
        self._covariance, self._state = np.array(prior), np.zeros(len(prior))
        self._sizes = np.square(spreads)[:, None]
        # Openings that are still thought of: number of the first sample and its place, two sums
        # over innovations, and what the filter makes of a step of one.
        self._openings = np.empty((0, 5 + len(prior)))

    def take(
        self, residual: float, deviation: float, row: Array, place: tuple[float, float]
    ) -> None:
        """Take the next residual, the deviation of its noise, its slopes (p,), and its place."""
        self.samples += 1
        new = [self.samples, *place, *np.zeros(2 + len(row))]
        self._openings = np.vstack([self._openings, new])
        starts, steps = self._openings[:, 0], self._openings[:, 5:]
        larger = max(1.0, self._squares / (_WORTH + self.samples - 1))
        gain = self._covariance @ row
        scale = np.sqrt(larger * deviation**2 + row @ gain)
        innovation = np.clip((residual - row @ self._state) / scale, -MOST, MOST)
        self._squares += float(larger * innovation**2)
        signature = (1.0 - steps @ row) / scale
        self._openings[:, 3:5] += np.column_stack(
            [signature * innovation, signature**2]
        )
        self._state += gain / scale * innovation
        steps += np.outer(signature, gain / scale)
        self._covariance -= np.outer(gain, gain) / scale**2
        weighted = self._log_ratios() - np.log(starts * (starts + 1.0))
        self.evidence = max(self.evidence, float(np.logaddexp.reduce(weighted)))
        if len(starts) > _KEPT:  # among the older half, the one that nothing speaks for
            self._openings = np.delete(
                self._openings, np.argmin(weighted[: _KEPT // 2]), axis=0
            )

    def since(self) -> Array:
        """Most likely first sample with a gap, and those that hold 95 % (first and last).

        Returns:
            Of each its number and its place, shape (3, 3).
        """
        ratios = self._log_ratios()
        weights = np.exp(ratios - ratios.max())
        order = np.argsort(-weights)
        held = order[
            : 1
            + int(np.searchsorted(np.cumsum(weights[order]), _LEVEL * weights.sum()))
        ]
        return self._openings[[order[0], held.min(), held.max()], :3]

    def _log_ratios(self) -> Array:
        along, square = self._openings[:, 3:5].T
        grown = 1.0 + self._sizes * square
        logs = 0.5 * (self._sizes * along**2 / grown - np.log(grown))
        return np.asarray(np.logaddexp.reduce(logs, axis=0) - np.log(len(logs)))


def step_size(
    residuals: Array, deviations: Array, rows: Array, prior: Array, start: int
) -> tuple[float, float]:
    """Size of a step from sample `start` (from 1) on, and its standard deviation.

    Least squares with what is not known of the base; single bad samples count little (Huber 1964).

    Args:
        residuals, deviations: shape (n,).
        rows: slopes, shape (n, p).
        prior: covariance of the unknowns, shape (p, p).
        start: first sample with the gap.
    """
    values, vectors = np.linalg.eigh(prior)  # a correlation may be complete
    step = np.arange(1, len(rows) + 1) >= start
    design = np.column_stack(
        [step, rows @ (vectors * np.sqrt(np.maximum(values, 0.0)))]
    )
    known = np.diag(np.append(0.0, np.ones(len(prior))))  # the prior, in standard units
    spread, weight = deviations, np.ones(len(rows))
    for _ in range(_ROUNDS):
        parts = (weight / spread**2)[:, None] * design
        normal = design.T @ parts + known
        found = np.linalg.solve(normal, parts.T @ residuals)
        left = residuals - design @ found
        # A gap need not be the same everywhere: its scatter widens the interval.
        excess = max(0.0, float(np.mean((left**2 - deviations**2)[step])))
        spread = np.sqrt(deviations**2 + step * excess)
        weight = 1.0 / np.maximum(1.0, np.abs(left) / (MOST * spread))
    return float(found[0]), float(np.sqrt(np.linalg.inv(normal)[0, 0]))


class Watch:
    """Compares bench samples with a model as they come; it changes nothing.

    What the model does not know of itself is no gap: its parameters may be off as their standard
    errors say, and its efficiency by a plane over stroke, engine speed and load, each part of the
    deviation by which a form is a little off (as in a diagnosis), or, where a model states no
    errors, of the paper's 1.12 %.
    """

    def __init__(
        self,
        model: EfficiencyModel,
        noise: float | None = None,
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
        from scipy.linalg import block_diag

        self._noise = (
            None if noise is None else float(EFFICIENCY_STD.check(noise, "noise"))
        )
        self.model, self._false_alarms = model, false_alarms
        self._prior = np.eye(_PLANE) * PAPER_EFFICIENCY_UNCERTAINTY**2
        if model.standard_errors and model.correlation is not None:
            self._prior = block_diag(
                np.eye(_PLANE) * EFFICIENCY_CHANNEL.misfit_spread**2, model.correlation
            )
        self._test = ChangeTest(self._prior, EFFICIENCY_CHANNEL.field_spreads)
        # Of the last samples with an answer: residual, deviation, stamp, slopes.
        self._rows: deque[Array] = deque(maxlen=_SIZED)
        self._taken, self._noticed, self._source = (
            0,
            0,
            "assumed, 1.12 % (paper, eq. (3))",
        )

    def take(self, samples: BenchSamples) -> None:
        """Take samples in the order in which they were measured.

        Raises:
            InputError: as of `stage_of_each`.
        """
        for row in self._compared(samples):
            self._taken += 1
            if not np.isfinite(row).all():
                continue
            self._rows.append(row.copy())
            self._test.take(row[0], row[1], row[3:], (self._taken, row[2]))
            if not self._noticed and self._test.evidence >= -np.log(self._false_alarms):
                self._noticed = self._taken

    def _compared(self, samples: BenchSamples) -> Array:
        model, points = self.model, samples.points
        stage_of_each(model.stages, samples)
        here, unknown = model.sensitivity(*points)
        deviation = PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency
        if self._noise is not None:
            deviation, self._source = np.full(len(samples), self._noise), "as stated"
        elif samples.efficiency_std is not None:
            deviation, self._source = samples.efficiency_std, "column efficiency_std"
        stamp = np.zeros(len(samples)) if samples.stamp is None else samples.stamp
        middle, half = np.mean(ENGINE_SPEED_LIMITS), np.ptp(ENGINE_SPEED_LIMITS) / 2.0
        slopes = [
            np.ones(len(samples)),
            points.displacement_ratio,
            (points.engine_speed - middle) / half,
            points.load_torque / _LOAD - 1.0,
            *unknown.T,
        ]
        deviation = np.hypot(deviation, EFFICIENCY_CHANNEL.misfit_spread)
        return np.column_stack([samples.efficiency - here, deviation, stamp, *slopes])

    @property
    def found(self) -> Opening:
        """What can be said now."""
        told: dict[str, Any] = {
            "samples": self._taken,
            "without_answer": self._taken - self._test.samples,
            "false_alarms": self._false_alarms,
            "noise": self._source,
            "open": bool(self._noticed),
        }
        if not self._noticed:
            return Opening(**told)
        (start, since, stamp), (_, first, _), (_, last, _) = self._test.since().tolist()
        rows = np.array(self._rows)
        size, deviation = step_size(
            rows[:, 0],
            rows[:, 1],
            rows[:, 3:],
            self._prior,
            int(start) - self._test.samples + len(rows),
        )
        return Opening(
            **told,
            noticed=self._noticed,
            since=int(since),
            since_interval=(int(first), int(last)),
            since_stamp=stamp or None,
            size=size,
            interval=(size - _QUANTILE * deviation, size + _QUANTILE * deviation),
        )


def watch(
    model: EfficiencyModel,
    samples: BenchSamples,
    *,
    noise: float | None = None,
    false_alarms: float = FALSE_ALARMS,
) -> Opening:
    """Watch samples, by their stamps where they have any; see `Watch`."""
    require_model_and_samples(model, samples)
    running = Watch(model, noise, false_alarms)
    running.take(
        samples
        if samples.stamp is None
        else samples.select(np.argsort(samples.stamp, kind="stable"))
    )
    return running.found

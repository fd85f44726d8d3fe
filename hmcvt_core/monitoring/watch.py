# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A sensor on the gap: has one opened in a stream of bench samples, since when, how large."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from ..benches.transmission.channels import EFFICIENCY_CHANNEL
from ..benches.transmission.readings import ASSUMED_NOISE
from ..files import picture, preformatted
from ..files.bench import BenchSamples
from ..model.checks import require_model_and_samples
from ..model.model import EfficiencyModel
from ..model.staged_samples import stage_of_each
from ..transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY
from ..transmission.ranges import EFFICIENCY_STD, ENGINE_SPEED_LIMITS, Array, Range
from .change_test import FALSE_ALARMS, ChangeTest, step_size

QUANTILE = 1.96
"""Of the normal distribution, for intervals of 95 %."""
KEPT_SAMPLES = 4000
"""Last samples that are kept to estimate the size of a gap; limits memory."""
MIDDLE_LOAD = 200.0
"""Load torque in the middle of the paper's tests, where the plane of the base is centred [N m]."""
PLANE_TERMS = 4
"""Level, and slopes over stroke, engine speed and load."""
_CHANCE = Range("false_alarms", 1e-9, 0.5, "-", "a fraction, not percent")


@dataclass(frozen=True, eq=False)
class Trace:
    """The last samples that a watch compared, those with an answer, n of them.

    Attributes:
        sample: numbers in the stream, from 1, shape (n,).
        residuals: measured less predicted efficiency [-], shape (n,).
        deviations: standard deviations of noise and form [-], shape (n,).
    """

    sample: Array
    residuals: Array
    deviations: Array


@dataclass(frozen=True)
class Opening:
    """Result of a watch: whether a gap has opened, since when, and how large it is.

    Attributes:
        samples: watched.
        without_answer: samples where the model has none; they are left out.
        false_alarms: chance that a stream without a gap, however long, ever raises an alarm.
        noise: where the deviation of the efficiency comes from.
        open: whether a gap has opened.
        noticed: number of the sample that raised the alarm, from 1; None without one.
        since: first sample with the gap, most likely; `since_interval` holds it at 95 %.
        since_interval: first and last sample of that interval.
        since_stamp: its time [s]; None where the samples have no stamps.
        size: mean gap since then, measured less predicted efficiency [-].
        interval: of `size`, at 95 %.
        trace: the last samples, for `plot`; it takes no part in comparisons and in `to_dict`.
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
    trace: Trace | None = field(default=None, repr=False, compare=False)

    @property
    def standard_error(self) -> float | None:
        """Standard error of `size` [-]."""
        if self.interval is None:
            return None
        low, high = self.interval
        return (high - low) / (2.0 * QUANTILE)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt watch --json`."""
        names = [item.name for item in fields(self) if item.name != "trace"]
        return {name: getattr(self, name) for name in names}

    def report(self) -> str:
        """Return the result as a sentence."""
        if self.size is None or self.interval is None or self.since_interval is None:
            return (
                f"no gap has opened in {self.samples} samples (a false alarm comes in at most "
                f"{100 * self.false_alarms:g} % of all streams, however long)"
            )
        low, high = sorted(100.0 * abs(end) for end in self.interval)
        if self.interval[0] < 0.0 < self.interval[1]:
            low = 0.0
        first, last = self.since_interval
        side = "below" if self.size < 0.0 else "above"
        return (
            f"a gap has opened: the bench reads {100 * abs(self.size):.2f} points "
            f"{side} the model (95 %: {low:.2f} to {high:.2f}), since sample "
            f"{self.since} (95 %: {first} to {last}), noticed at sample {self.noticed}"
        )

    def __str__(self) -> str:
        return self.report()

    def plot(self, ax: Any = None) -> Any:
        """Draw the residuals of the last samples, and the gap since it opened.

        Args:
            ax: matplotlib Axes to draw into; None makes a figure.

        Returns:
            The matplotlib figure.

        Raises:
            InputError: matplotlib is missing.
        """
        return picture(self, ax=ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


@dataclass(frozen=True, eq=False)
class _Compared:
    """One sample against the model: residual, deviation of its noise, slopes, number and stamp."""

    residual: float
    deviation: float
    slopes: Array
    sample: int
    stamp: float


class Watch:
    """Compares bench samples with a model as they come; it changes nothing.

    What the model does not know of itself is no gap: its parameters may be off by their standard
    errors, and its efficiency by a plane over stroke, engine speed and load. Each term of that
    plane has the deviation by which a form is a little off (as in a diagnosis), or, where a model
    states no errors, the paper's 1.12 %.
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
            InputError: the noise or the chance is out of range.
        """
        if noise is not None:
            noise = float(EFFICIENCY_STD.check(noise, "noise"))
        self.model = model
        self._noise = noise
        self._false_alarms = float(_CHANCE.check(false_alarms))
        self._prior = _prior_of(model)
        self._test = ChangeTest(self._prior, EFFICIENCY_CHANNEL.field_spreads)
        self._compared: deque[_Compared] = deque(maxlen=KEPT_SAMPLES)
        self._samples = 0
        self._noticed: int | None = None
        self._noise_source = ASSUMED_NOISE

    def take(self, samples: BenchSamples) -> None:
        """Take samples in the order in which they were measured.

        Raises:
            InputError: as of `stage_of_each`.
        """
        stage_of_each(self.model.stages, samples)
        predicted, parameter_slopes = self.model.sensitivity(*samples.points)
        residuals = samples.efficiency - predicted
        deviations = np.hypot(
            self._deviations(samples), EFFICIENCY_CHANNEL.misfit_spread
        )
        slopes = np.column_stack([_plane(samples), parameter_slopes])
        stamps = samples.stamp
        if stamps is None:
            stamps = np.zeros(len(samples))
        answered = (
            np.isfinite(residuals)
            & np.isfinite(deviations)
            & np.isfinite(slopes).all(axis=1)
        )
        for i in range(len(samples)):
            self._samples += 1
            if answered[i]:
                self._take_one(
                    _Compared(
                        float(residuals[i]),
                        float(deviations[i]),
                        slopes[i].copy(),
                        self._samples,
                        float(stamps[i]),
                    )
                )

    def _take_one(self, row: _Compared) -> None:
        self._compared.append(row)
        self._test.take(row.residual, row.deviation, row.slopes, row.sample, row.stamp)
        limit = -np.log(self._false_alarms)
        if self._noticed is None and self._test.evidence >= limit:
            self._noticed = row.sample

    def _deviations(self, samples: BenchSamples) -> Array:
        """Standard deviation of the measured efficiency [-], shape (n,); notes its source."""
        if self._noise is not None:
            self._noise_source = "as stated"
            return np.full(len(samples), self._noise)
        if samples.efficiency_std is not None:
            self._noise_source = "column efficiency_std"
            return samples.efficiency_std
        return PAPER_EFFICIENCY_UNCERTAINTY * samples.efficiency

    @property
    def result(self) -> Opening:
        """The state after the samples taken so far."""
        rows = list(self._compared)
        trace = Trace(
            np.array([row.sample for row in rows], dtype=float),
            np.array([row.residual for row in rows]),
            np.array([row.deviation for row in rows]),
        )
        common: dict[str, Any] = {
            "samples": self._samples,
            "without_answer": self._samples - self._test.samples,
            "false_alarms": self._false_alarms,
            "noise": self._noise_source,
            "open": self._noticed is not None,
            "trace": trace,
        }
        if self._noticed is None:
            return Opening(**common)
        start, first, last = self._test.start()
        forgotten = self._test.samples - len(rows)
        size, deviation = step_size(
            trace.residuals,
            trace.deviations,
            np.array([row.slopes for row in rows]),
            self._prior,
            start.number - forgotten,
        )
        return Opening(
            **common,
            noticed=self._noticed,
            since=start.sample,
            since_interval=(first.sample, last.sample),
            since_stamp=start.stamp or None,
            size=size,
            interval=(size - QUANTILE * deviation, size + QUANTILE * deviation),
        )

    @property
    def found(self) -> Opening:
        """Earlier name of `result`."""
        return self.result


def _prior_of(model: EfficiencyModel) -> Array:
    """Covariance of the plane, and of the parameters in their standard errors, (4, 4) or (7, 7)."""
    from scipy.linalg import block_diag

    plane = np.eye(PLANE_TERMS)
    if model.states_errors:
        plane *= EFFICIENCY_CHANNEL.misfit_spread**2
        return np.asarray(block_diag(plane, model.correlation))
    return plane * PAPER_EFFICIENCY_UNCERTAINTY**2


def _plane(samples: BenchSamples) -> Array:
    """Level and slopes over the operating points, each about 1 at the ends, shape (n, 4)."""
    points = samples.points
    middle = np.mean(ENGINE_SPEED_LIMITS)
    half = np.ptp(ENGINE_SPEED_LIMITS) / 2.0
    return np.column_stack(
        [
            np.ones(len(samples)),
            points.displacement_ratio,
            (points.engine_speed - middle) / half,
            points.load_torque / MIDDLE_LOAD - 1.0,
        ]
    )


def watch(
    model: EfficiencyModel,
    samples: BenchSamples,
    *,
    noise: float | None = None,
    false_alarms: float = FALSE_ALARMS,
) -> Opening:
    """Watch samples, in the order of their stamps where they have any.

    Args:
        model: as of `Watch`.
        samples: bench samples.
        noise: as of `Watch`.
        false_alarms: as of `Watch`.

    Returns:
        The state after the last sample.

    Raises:
        InputError: as of `Watch`.
    """
    require_model_and_samples(model, samples)
    running = Watch(model, noise, false_alarms)
    if samples.stamp is not None:
        samples = samples.select(np.argsort(samples.stamp, kind="stable"))
    running.take(samples)
    return running.result

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Sound samples that are left out of the fit, and must come out as no change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...diagnosis.detection.regions import candidate_regions
from ...diagnosis.detection.significance import significance
from ...diagnosis.observations import Observations
from ...diagnosis.preparation import prepare
from ...diagnosis.settings import GAP_SIGNIFICANCE
from ...diagnosis.system import Array
from ...errors import InputError
from .change import CLASS_TO_DRIFT, Change, SoundMachine, with_sound_uncertainty
from .remainder import LeftOut

CONTROL_FRACTION = 0.25
"""Fraction of the sound samples that is left out as a control.

A fifth to a third is the usual range of a holdout.
"""
MIN_CONTROL = 6
"""Minimum number of samples of a control: as many as a diagnosis with one parameter needs."""
MIN_FITTED = 10
"""Minimum number of sound samples that are fitted: two for each physical term of a channel."""
MIN_SOUND = MIN_CONTROL + MIN_FITTED
"""Minimum number of samples of a baseline."""

THIN_FRACTION = 0.8
"""Fraction of the squared deviation of a reading about the sound prediction that is the baseline's,
above which the baseline is too thin: its prediction is then known half as well as a reading.
"""
NORMAL_MEDIAN = 0.6745
"""Median of the magnitude of a standard normal variable."""
DRAWS = 2000
"""Draws of the baseline; they resolve probabilities of a thousandth."""

Index = NDArray[np.intp]


class Control(NamedTuple):
    """Outcome of the control.

    Attributes:
        samples: number of sound samples left out of the fit.
        verdict: `no_gap`, or `unexplained` where they differ from those that were fitted.
        p_value: probability that no change shows as much.
        ratio: how many times as large the differences are as the deviations that the fit states,
            by their medians, of the worst channel.
    """

    samples: int
    verdict: str
    p_value: float
    ratio: float = 1.0

    @property
    def alarms(self) -> bool:
        """Whether the control differs from the other sound samples."""
        return self.verdict != "no_gap"

    @property
    def inflation(self) -> float:
        """Factor by which a baseline that fails its control is less certain than it states.

        Samples left out of the fit measure its errors, whatever the fit takes for granted (split
        conformal prediction; Lei et al. 2018, J. Am. Stat. Assoc. 113, 1094).
        """
        return max(self.ratio, 1.0) if self.alarms else 1.0


def control_and_rest(samples: Any, seed: int) -> tuple[Index, Index]:
    """Divide the sound samples at random into a control and those that are fitted.

    Args:
        samples: of the baseline, with a length and a `source`.
        seed: of the division.

    Returns:
        Their indices, in order.

    Raises:
        InputError: there are too few.
    """
    n = len(samples)
    if n < MIN_SOUND:
        raise InputError(
            f"{samples.source}: {n} samples are too few for a baseline; at least "
            f"{MIN_SOUND} are needed, {MIN_FITTED} to fit and {MIN_CONTROL} as a control"
        )
    count = max(MIN_CONTROL, round(CONTROL_FRACTION * n))
    order = np.random.default_rng(seed).permutation(n)
    return np.sort(order[:count]), np.sort(order[count:])


def judge_control(machine: SoundMachine, observed: Observations, seed: int) -> Control:
    """Test whether sound samples that were left out show a change.

    Args:
        machine: fitted to the other sound samples.
        observed: those left out, with the noise that the machine states.
        seed: of every random number.
    """
    system = Change(machine, meters=CLASS_TO_DRIFT)
    base, *_ = prepare(system, with_sound_uncertainty(observed, machine))
    boxes = candidate_regions(base.observed.coordinates)
    p_value = float(significance(base, boxes, seed).p_value)
    verdict = "no_gap"
    excess = excess_of(machine, observed, seed)
    if p_value <= GAP_SIGNIFICANCE and excess.is_change:
        verdict = "unexplained"
    return Control(len(observed), verdict, p_value, excess.ratio)


@dataclass(frozen=True)
class Excess:
    """How far readings differ from a sound machine, against its left-out readings.

    Attributes:
        p_value: probability that left-out readings of the baseline differ as much in any channel.
        deviation: standard deviation of a reading of the first channel about the sound prediction,
            root mean square over the readings.
        sound_part: part of its square that is the uncertainty of the sound prediction.
        ratio: median of the differences / that of normal ones, of the worst channel.
    """

    p_value: float
    deviation: float
    sound_part: float
    ratio: float

    @property
    def is_change(self) -> bool:
        """Whether the readings differ by more than left-out readings of the baseline do."""
        return self.p_value <= GAP_SIGNIFICANCE

    @property
    def is_thin(self) -> bool:
        """Whether the baseline is too thin to show a change that single readings would show."""
        return self.sound_part > THIN_FRACTION


def excess_of(machine: SoundMachine, observed: Observations, seed: int) -> Excess:
    """Compare readings with left-out readings of the baseline.

    A few readings that stand apart make a difference significant, and any bench has some. The mean
    of log(1 + z^2) over the standardised differences z, which single readings barely move, is
    compared with that of draws. A draw consists of runs of left-out residuals of the baseline
    (block bootstrap; Kuensch 1989, Ann. Stat. 17, 1217) and of one error of the sound prediction,
    which all readings share.

    Args:
        machine: held.
        observed: readings of the changed machine, with the noise that the machine states.
        seed: of the draws.
    """
    sound, of_sound = machine.sound_at(observed.points)
    covariance = of_sound + _shared_covariance(observed)
    drift = machine.drift_at(observed.points, observed.deviation)
    of_readings = np.diagonal(drift, axis1=1, axis2=2) + observed.deviation**2
    total = np.diagonal(covariance, axis1=1, axis2=2) + of_readings
    differences = np.abs(observed.measured - sound) / np.sqrt(total)
    sizes = np.mean(np.log1p(differences**2), axis=1)
    rng = np.random.default_rng(seed)
    left_out = machine.left_out_residuals()
    p_values = []
    for i, size in enumerate(sizes):
        errors = _errors_of_prediction(covariance[i], rng)
        scatter = _runs(left_out[i], len(observed), rng) * np.sqrt(of_readings[i])
        draws = (errors + scatter) ** 2 / total[i]
        p_values.append(np.mean(np.mean(np.log1p(draws), axis=1) >= size))
    variance = float(np.mean(total[0]))
    return Excess(
        p_value=_of_any(min(p_values), len(p_values)),
        deviation=float(np.sqrt(variance)),
        sound_part=float(np.mean(np.diagonal(of_sound[0]))) / variance,
        ratio=float(np.median(differences, axis=1).max()) / NORMAL_MEDIAN,
    )


def _of_any(smallest: float, count: int) -> float:
    """Return the probability that the smallest of several p-values is as small by chance.

    Sidak 1967, J. Am. Stat. Assoc. 62, 626: exact for independent ones, conservative for others.

    Args:
        smallest: of the p-values.
        count: of the p-values.
    """
    return float(-np.expm1(count * np.log1p(-smallest))) if smallest < 1.0 else 1.0


def _shared_covariance(observed: Observations) -> Array:
    """Return the covariance of errors that the readings share, shape (channels, n, n)."""
    shared = observed.shared_columns * observed.deviation[..., None]
    return np.asarray(shared @ shared.transpose(0, 2, 1))


def _errors_of_prediction(covariance: Array, rng: np.random.Generator) -> Array:
    """Return draws of a normal distribution around zero, shape (draws, n).

    Args:
        covariance: of the sound prediction and of shared errors, shape (n, n).
        rng: of the draws.
    """
    values, vectors = np.linalg.eigh(covariance)
    scaled = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(rng.standard_normal((DRAWS, len(values))) @ scaled.T)


def _runs(left_out: LeftOut, count: int, rng: np.random.Generator) -> Array:
    """Return so many residuals, drawn in runs, shape (draws, count).

    Args:
        left_out: residuals of the baseline.
        count: number of residuals in a draw.
        rng: of the draws.
    """
    residuals = left_out.residuals
    run = min(left_out.run, len(residuals))
    runs = -(-count // run)
    starts = rng.integers(0, len(residuals) - run + 1, (DRAWS, runs))
    rows = (starts[..., None] + np.arange(run)).reshape(DRAWS, -1)[:, :count]
    return np.asarray(residuals[rows])

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Statement: whether readings agree with a model within the noise stated for them.

The model is refitted with the noise held at its statement, so that no scatter is explained away as
noise. Of the residuals r of a part S of the readings the square is compared with its distribution
at the stated noise. With the projector P that the refit leaves, restricted to S,

.. math:: E\,r_S^Tr_S = \mathrm{tr}\,P_{SS}, \qquad
          \mathrm{var}\,r_S^Tr_S = 2\,\mathrm{tr}\,P_{SS}^2

which a scaled chi squared matches (Satterthwaite 1946, Biometrics Bull. 2, 110). The parts are all
samples, each stage, each session, thirds of the range of each axis, and the errors of the meters
that the refit assumes, against the class of the meters: all together, and each error over the
sessions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.refit import Fit, refit
from ..observations import REPEATED_POINTS, SESSION, Observations
from ..settings import (
    AGREEMENT_LEVEL,
    CONVERGED_STEP,
    NOISE_STATEMENT_TOLERANCE,
    REGION_SAMPLES,
)
from ..system import Array, Axis
from ..wording import fixed

METERS = "the errors of the meters"
"""Look at what the refit takes for errors that readings share, against their priors."""


@dataclass(frozen=True)
class Look:
    """One part of the readings against its stated noise.

    Attributes:
        channel: name of the channel.
        part: which samples, in words; empty for all of them.
        samples: how many.
        ratio: root mean square of the residuals / stated noise.
        p_value: probability of a ratio at least as large at the stated noise, over all looks.
        of_meters: whether it is of errors that readings share, against the class of the meters.
    """

    channel: str
    part: str
    samples: int
    ratio: float
    p_value: float
    of_meters: bool = False


@dataclass(frozen=True)
class Agreement:
    """Readings against their stated noise, before any noise is estimated.

    Attributes:
        stated: whether the noise was stated; nothing can disagree otherwise.
        holds: whether no look exceeds the statement.
        ratio: root mean square of the residuals / stated noise, the largest of the looks at
            readings, of `looks` where all are of meters, or of all samples where the statement
            holds; 1 where nothing was stated.
        looks: those that exceed the statement, all samples first, then their parts.
    """

    stated: bool
    holds: bool
    ratio: float
    looks: tuple[Look, ...] = ()

    @property
    def readings(self) -> list[Look]:
        """The looks that are not of the errors of meters."""
        return [look for look in self.looks if not look.of_meters]

    @property
    def of_meters_alone(self) -> bool:
        """Whether the readings agree, but only with meters outside their class."""
        return not self.holds and not self.readings


NOTHING_STATED = Agreement(stated=False, holds=True, ratio=1.0)


def agreement_of(fit: Fit) -> Agreement:
    """Return how readings agree with their stated noise.

    The noise of the first channel is what users state; that of the others is assumed.

    Args:
        fit: a refit to the readings, with or without effects.
    """
    observed = fit.observed
    if observed.assumed:
        return NOTHING_STATED
    rows = rows_at_statement(fit)
    parts = list(_parts(observed))
    meters = _meters(observed, rows.of_shared_errors)
    # Half of the level is for all samples together, half for their parts.
    of_parts = 2.0 * (len(parts) + len(meters))
    looks = [_look(rows, "", np.arange(len(observed)), 2.0)]
    looks += [_look(rows, words, members, of_parts) for words, members in parts]
    for words, members in meters:
        look = _look(rows, words, members, of_parts)
        looks.append(replace(look, of_meters=True))
    exceeding = [look for look in looks if look.p_value <= AGREEMENT_LEVEL]
    # A ratio of meters is one to their class, not to the noise of the readings.
    compared = [look for look in exceeding if not look.of_meters] or exceeding
    return Agreement(
        stated=True,
        holds=not exceeding,
        ratio=max((look.ratio for look in compared), default=looks[0].ratio),
        looks=tuple(exceeding),
    )


class RowsAtStatement(NamedTuple):
    """Residuals of a refit with the noise held at its statement, and what the refit absorbs.

    The rows are the readings, one channel after another, in their deviations, and then one for each
    prior, in its deviations.

    Attributes:
        unit: 1 / noise of each channel by which it is weighed, shape (channels, 1).
        residuals: shape (channels x n + p,).
        absorbed: orthonormal columns, shape (channels x n + p, p).
        of_shared_errors: which rows are the priors of errors that readings share.
        fit: the refit.
    """

    unit: Array
    residuals: Array
    absorbed: Array
    of_shared_errors: NDArray[np.intp]
    fit: Fit


def rows_at_statement(fit: Fit) -> RowsAtStatement:
    """Refit with the noise of the first channel held at its statement.

    Args:
        fit: a refit to the readings, with or without effects.
    """
    held = np.append(1.0, fit.noise[1:])
    hypothesis = fit.hypothesis
    # To the end: a chi squared is compared with its distribution to a few per cent.
    at_statement = refit(
        hypothesis, fit.observed, fit.theta, noise=held, negligible=CONVERGED_STEP
    )
    unit = 1.0 / np.sqrt(held)[:, None]
    count = at_statement.whitened.size
    scaled = (at_statement.jacobian * unit[..., None]).reshape(count, -1)
    prior = 1.0 / hypothesis.spread(np.inf)
    basis, _ = np.linalg.qr(np.concatenate([scaled, np.diag(prior)]))
    of_priors = prior * (hypothesis.prior_mean - at_statement.theta)
    # A size has no prior, so that its row is zero.
    residuals = np.append((at_statement.whitened * unit).ravel(), of_priors)
    shared = hypothesis.shared
    of_shared_errors = np.arange(count + shared.start, count + shared.stop)
    return RowsAtStatement(unit, residuals, basis, of_shared_errors, at_statement)


def _look(
    rows: RowsAtStatement, words: str, members: NDArray[np.intp], count: float
) -> Look:
    """Return some rows against their statement.

    Args:
        rows: of the refit.
        words: what they are.
        members: which rows.
        count: of the looks among which the level is shared (Bonferroni).
    """
    observed = rows.fit.observed
    ratio, p_value = _excess(rows.residuals[members], rows.absorbed[members], observed)
    channel = observed.channels[0].name
    return Look(channel, words, len(members), ratio, min(count * p_value, 1.0))


def _excess(
    residuals: Array, absorbed: Array, observed: Observations
) -> tuple[float, float]:
    """Return the ratio of residuals to their statement, and the probability of a larger one.

    Args:
        residuals: in stated deviations, shape (n,).
        absorbed: rows of the basis of what the refit absorbs, shape (n, p).
        observed: gives the source of the statement.
    """
    from scipy.special import chdtrc, fdtrc

    n = len(residuals)
    within = absorbed.T @ absorbed
    mean = max(n - float(np.trace(within)), 1e-6)
    variance = 2.0 * max(n - 2.0 * np.trace(within) + np.sum(within**2), 1e-6)
    degrees_of_freedom = 2.0 * mean**2 / variance
    variance_ratio = float(np.sum(residuals**2)) / mean
    if observed.noise_source == REPEATED_POINTS:
        # The statement is an estimate with degrees of freedom of its own.
        of_statement = float(observed.prior_dof[0])
        p_value = fdtrc(degrees_of_freedom, of_statement, variance_ratio)
    else:
        allowed = variance_ratio / NOISE_STATEMENT_TOLERANCE**2
        p_value = chdtrc(degrees_of_freedom, degrees_of_freedom * allowed)
    return float(np.sqrt(variance_ratio)), float(p_value)


def _parts(observed: Observations) -> Iterator[tuple[str, NDArray[np.intp]]]:
    """Return parts of the samples, in words and as rows; those of few samples are left out."""
    parts = (*_stages(observed), *_sessions(observed), *_thirds(observed))
    for words, members in parts:
        if REGION_SAMPLES <= members.sum() < len(observed):
            yield words, np.flatnonzero(members)


def _meters(
    observed: Observations, rows: NDArray[np.intp]
) -> list[tuple[str, NDArray[np.intp]]]:
    """Return the errors that readings share, all together and each one over the sessions.

    Args:
        observed: the readings; those compared with a baseline share its errors too, without names.
        rows: of the priors of these errors, shape (m,).
    """
    if not observed.shared_count:
        return []
    parts = [(METERS, rows)]
    with_sessions = {item.name for item in observed.shared_names if item.session}
    of_sessions: dict[str, list[int]] = {}
    for i, item in enumerate(observed.shared_names):
        # The name of one session may be empty.
        if item.name in with_sessions:
            of_sessions.setdefault(item.name, []).append(i)
    for name, numbers in of_sessions.items():
        if len(numbers) > 1:
            article = "" if name.startswith("half ") else "the "
            parts.append((f"{article}{name}", rows[numbers]))
    return parts


def _stages(observed: Observations) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    for axis in observed.axes:
        for number, label in enumerate(axis.labels):
            yield f"{axis.word} {label}", observed.points[axis.name] == number


def _sessions(observed: Observations) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    if SESSION not in observed.points:
        return
    numbers = observed.points[SESSION]
    for number in np.unique(numbers[numbers >= 0.0]):
        yield f"session {number + 1:.0f}", numbers == number


def _thirds(observed: Observations) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    for axis, values in zip(observed.steered, observed.coordinates, strict=True):
        # Tests of one grid value stay together, whatever their last digits.
        low, high = np.quantile(values, (1.0 / 3.0, 2.0 / 3.0)) + axis.tolerance
        members = (values <= low, (values > low) & (values <= high), values > high)
        for degree, inside in zip(("low", "medium", "high"), members, strict=True):
            if inside.any():
                yield _third_in_words(axis, degree, values[inside]), inside


def _third_in_words(axis: Axis, degree: str, values: Array) -> str:
    if axis.graded:
        return f"{degree} {axis.word}"
    low, high = (
        fixed(float(limit), axis.digits) for limit in (values.min(), values.max())
    )
    return f"{axis.word} {low} to {high}"

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Which families of a discrepancy are present.

A discrepancy is a sum of families of functions: those of one axis, and products of several axes.
An inexact base or form needs few of them, and an exact one none. Every subset S of k of the m
families is therefore a model of its own, with the prior under which the readings decide how
many families are present (Scott & Berger 2010, Ann. Stat. 38, 2587):

.. math:: p(S) = \frac{1}{m + 1} \binom{m}{k}^{-1}

From none on, the likeliest family is added until the posterior falls (forward selection). The
evidence is the sum over all subsets that were looked at.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.evidence import LinearModel, gram
from ..observations import Observations
from ..settings import AMPLITUDE_LOG_DEVIATION, MAX_FAMILIES
from ..system import Array
from .discrepancy import Columns

_DEVIATIONS = np.arange(-1.0, 5.0)
"""Log variances at which a family is looked at, in prior deviations; large gaps need large ones."""

_AMPLITUDES = np.exp(0.5 * AMPLITUDE_LOG_DEVIATION * _DEVIATIONS)

_LOG_WEIGHTS = -0.5 * _DEVIATIONS**2 - np.logaddexp.reduce(-0.5 * _DEVIATIONS**2)
"""Log of their prior probabilities."""


class Selection(NamedTuple):
    """Outcome of a selection of families.

    Attributes:
        model: with the likeliest families.
        families: their numbers, ascending.
        log_evidence: over all subsets that were looked at [nats].
    """

    model: LinearModel
    families: tuple[int, ...]
    log_evidence: float


def select_families(
    observed: Observations,
    columns: Columns,
    target: Array,
    optional: NDArray[np.intp],
    least: int = 0,
    known: LinearModel | None = None,
) -> Selection:
    """Select the families of columns that are present.

    Args:
        observed: the readings.
        columns: of the model with all families.
        target: what the coefficients reproduce, shape (channels, n).
        optional: numbers of the families that may be absent, at least one.
        least: how many of these are present at least, 0 or 1.
        known: the fitted model without any of these; None to fit it.
    """
    log_priors = log_prior_of_subset(len(optional), least)
    gains = _Gains(columns, target, optional)
    is_present = ~np.isin(columns.group, optional)
    model = known or columns.where(is_present).fitted(observed, target)
    log_posterior = model.log_evidence + log_priors[0]
    log_posteriors = [log_posterior]
    for log_prior in log_priors[1 : MAX_FAMILIES + 1]:
        absent = np.setdiff1d(optional, columns.group[is_present])
        by_amplitude = gains.of(absent, model, is_present) + _LOG_WEIGHTS[:, None]
        gain = np.logaddexp.reduce(by_amplitude)
        likeliest = int(gain.argmax())
        others = np.delete(gain, likeliest)
        log_posteriors.extend(model.log_evidence + others + log_prior)

        is_added = columns.group == absent[likeliest]
        start_spread = columns.spread.copy()
        start_spread[is_present] = model.spread
        start_spread[is_added] *= _AMPLITUDES[by_amplitude[:, likeliest].argmax()]
        is_extended = is_present | is_added
        start = start_spread[is_extended], model.noise
        extended = columns.where(is_extended).fitted(observed, target, start)
        log_posterior_extended = extended.log_evidence + log_prior
        log_posteriors.append(log_posterior_extended)
        if log_posterior_extended < log_posterior:
            break
        model = extended
        is_present = is_extended
        log_posterior = log_posterior_extended
    families = np.intersect1d(optional, columns.group[is_present])
    log_evidence = float(np.logaddexp.reduce(log_posteriors))
    return Selection(model, tuple(families.tolist()), log_evidence)


def log_prior_of_subset(count: int, least: int = 0) -> Array:
    """Return the log prior of one subset of each size, from no family to all of them.

    Args:
        count: how many families there are.
        least: how many of these are present at least.

    Returns:
        Shape (count + 1,).
    """
    from scipy.special import gammaln

    size = np.arange(count + 1)
    log_subsets = gammaln(count + 1) - gammaln(size + 1) - gammaln(count - size + 1)
    log_prior = -log_subsets - np.log(count + 1 - least)
    return np.where(size < least, -np.inf, log_prior)


class _Gains:
    """Gains in log evidence by single families, from one Gram matrix of all columns.

    Attributes:
        grams: of the columns in their prior deviations, a column of zeros, and the target, by
            channel.
        spread: the prior deviations.
        members: columns of each family, filled up with the column of zeros.
    """

    def __init__(
        self, columns: Columns, target: Array, families: NDArray[np.intp]
    ) -> None:
        scaled = columns.columns * columns.spread
        zeros = np.zeros((*target.shape, 1))
        self.grams = gram(np.concatenate([scaled, zeros], axis=-1), target)
        self.spread = columns.spread
        by_family = {
            int(family): np.flatnonzero(columns.group == family) for family in families
        }
        most = max(len(members) for members in by_family.values())
        self.members = {}
        for family, members in by_family.items():
            fill = np.full(most - len(members), len(columns.spread))
            self.members[family] = np.append(members, fill)

    def of(
        self,
        families: NDArray[np.intp],
        model: LinearModel,
        is_present: NDArray[np.bool_],
    ) -> Array:
        r"""Return the gain by each family, at the noise of the model without it.

        With the columns U of the family, r the residuals of the model, P the precision of the
        readings under it, and the prior covariance :math:`v S^2`:

        .. math:: \log B = \tfrac12 r^TPU (U^TPU + (v S^2)^{-1})^{-1} U^TPr
                  - \tfrac12 \log|I + v S\,U^TPU\,S|

        Args:
            families: numbers of the families.
            model: without them.
            is_present: which columns the model has.

        Returns:
            Shape (amplitudes, families), at each of the amplitudes that are looked at.
        """
        weighted = np.sum(self.grams / model.noise[:, None, None], axis=0)
        members = np.stack([self.members[int(family)] for family in families])
        with_model = weighted[np.flatnonzero(is_present)]
        with_model = with_model / self.spread[is_present, None]
        absorbed = model.covariance @ with_model
        pull = weighted[-1] - model.mean @ with_model
        # f: family, k and l: its columns, p: column of the model.
        information = weighted[members[:, :, None], members[:, None, :]]
        information -= np.einsum(
            "pfk,pfl->fkl", with_model[:, members], absorbed[:, members]
        )
        values, vectors = np.linalg.eigh(information)
        squares = np.einsum("fk,fkl->fl", pull[members], vectors) ** 2
        variance = np.square(_AMPLITUDES)[:, None, None]
        ratios = variance * values.clip(0.0)
        signal = variance * squares / (1.0 + ratios)
        return np.asarray(0.5 * np.sum(signal - np.log1p(ratios), axis=-1))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Linear models with Gaussian priors and unknown noise of each channel: evidence and errors.

Near its refit every hypothesis is linear: y = J t + e with t ~ N(0, S) and e_c ~ N(0, phi_c I) in
channel c. The noise variances phi_c have inverse-gamma priors around what was stated and are set
to their posterior mode; everything else is integrated out:

.. math:: \log p(y) = -\tfrac12\sum_c\left[(n_c+\nu_c)\log\phi_c + \nu_c/\phi_c\right]
          -\tfrac12\left[\sum_c R_c/\phi_c + m^TS^{-1}m\right]
          -\tfrac12\log|S\,A|, \qquad A = \sum_c J_c^TJ_c/\phi_c + S^{-1}

(constants common to all hypotheses left out). Only Gram matrices enter, so thousands of models over
the same samples cost one product each. See MacKay, *Bayesian interpolation* (1992).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..observations import Observations
from ..settings import NOISE_ROUNDS, NOISE_TOLERANCE
from ..system import Array


class ModelEvidence(NamedTuple):
    """Evidence of m models.

    Attributes:
        log: log evidence up to a common constant, shape (m,).
        mean: posterior mean of the coefficients, shape (m, p).
        covariance: posterior covariance, shape (m, p, p).
        noise: variance of each channel, shape (m, channels).
    """

    log_evidence: Array
    mean: Array
    covariance: Array
    noise: Array


def gram(columns: Array, target: Array) -> Array:
    """Gram matrices of [columns, target] by channel.

    Args:
        columns: shape (..., channels, n, p).
        target: shape (..., channels, n).

    Returns:
        Shape (..., channels, p + 1, p + 1).
    """
    both = np.concatenate([columns, target[..., None]], axis=-1)
    return np.asarray(np.swapaxes(both, -1, -2) @ both)


def model_evidence(
    grams: Array,
    count: int | NDArray[np.intp],
    spread: Array,
    prior_dof: Array,
    signs: Array | None = None,
) -> ModelEvidence:
    """Weigh m linear models.

    Args:
        grams: of [columns, target], shape (m, channels, p + 1, p + 1).
        count: samples per channel; shape (m, 1) where the models have different ones.
        spread: prior standard deviations of the coefficients, shape (p,) or (m, p).
        prior_dof: worth of the stated noise in samples, shape (channels,).
        signs: of coefficients that are sizes of effects, see `moment_prior_log_bayes_factor`; NaN for the others and
            by default, shape (p,) or (m, p).
    """
    square, cross, total = grams[..., :-1, :-1], grams[..., :-1, -1], grams[..., -1, -1]
    precision = spread**-2.0
    p = spread.shape[-1]
    noise, flat = np.ones(total.shape), square.reshape(*total.shape, p * p)
    for _ in range(NOISE_ROUNDS):
        weights = 1.0 / noise[:, None]
        matrix = (weights @ flat).reshape(-1, p, p)
        matrix[:, np.arange(p), np.arange(p)] += precision
        covariance = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        mean = ((weights @ cross) @ covariance)[:, 0]
        fitted = (square @ mean[:, None, :, None])[..., 0] - 2.0 * cross
        residual = np.maximum(total + (fitted @ mean[..., None])[..., 0], 1e-12)
        # The part of the noise that the fitted coefficients hide.
        hidden = (flat @ covariance.reshape(-1, p * p, 1))[..., 0]
        noise, before = (prior_dof + residual + hidden) / (prior_dof + count), noise
        if (np.abs(noise / before - 1.0) < NOISE_TOLERANCE).all():
            break
    _, logdet = np.linalg.slogdet(matrix)
    log = -0.5 * (
        np.sum(
            (count + prior_dof) * np.log(noise) + (prior_dof + residual) / noise, axis=1
        )
        + np.sum(precision * mean**2, axis=1)
        + logdet
        + 2.0 * np.sum(np.log(spread), axis=-1)
    )
    if signs is not None:
        log += moment_prior_log_bayes_factor(
            mean, np.diagonal(covariance, axis1=1, axis2=2), spread, signs
        )
    return ModelEvidence(log, mean, covariance, noise)


def change_of_prior_scale(
    mean: Array, covariance: Array, spread: Array, others: Array, signs: Array
) -> Array:
    r"""Log evidence of a model under other priors of some coefficients, against the one it had.

    The likelihood is what the posterior N(mean, covariance) has beside its prior; at the same
    noise the evidence under another one is exact, whatever the correlations.

    Args:
        mean, covariance: posterior of these coefficients, shapes (k,) and (k, k).
        spread: the prior they had, shape (k,).
        others: prior standard deviations instead, shape (m, k).
        signs: as `moment_prior_log_bayes_factor` takes them, shape (k,); in the model they have not been counted.
    """
    known = np.linalg.inv(covariance)
    pull = known @ mean
    precision = (
        known - np.diag(spread**-2.0) + np.stack([np.diag(one**-2.0) for one in others])
    )
    narrower = np.linalg.inv(precision)
    there = narrower @ pull
    return np.asarray(
        0.5
        * (
            there @ pull
            - mean @ pull
            - np.linalg.slogdet(precision)[1]
            + np.linalg.slogdet(known)[1]
        )
        + np.sum(np.log(spread / others), axis=1)
        + moment_prior_log_bayes_factor(
            there, np.diagonal(narrower, axis1=1, axis2=2), others, signs
        )
    )


def moment_prior_log_bayes_factor(
    mean: Array, variance: Array, spread: Array, signs: Array
) -> Array:
    r"""Log of what evidence changes by when sizes have a prior that is none at zero.

    An effect too small to matter is no cause: :math:`p(a) = a^2 / s^2 \; N(a; 0, s^2)` instead of
    the normal (moment prior; Johnson & Rossell 2010, J. R. Stat. Soc. B 72, 143). Evidence against
    an effect that is not there then grows with the samples as fast as evidence for one that is.

    Args:
        mean, variance: posterior under the normal prior, one by one, shapes (m, p).
        spread: its standard deviations, the same shape.
        signs: 1 or -1 for a size that has only that sign, 0 for one that may have either, NaN for
            what is no size, shape (p,) or (m, p).

    Returns:
        The sum over the sizes, shape (m,).
    """
    from scipy.special import log_ndtr

    deviation, one = np.sqrt(variance), np.nan_to_num(signs)
    ratio = one * mean / deviation
    log_part = log_ndtr(ratio)  # of the posterior that has the sign
    hazard = np.exp(-0.5 * (ratio**2 + np.log(2.0 * np.pi)) - log_part)
    squares = mean**2 + variance + one * mean * deviation * hazard
    each = np.log(np.maximum(squares, 1e-300) / spread**2) + np.where(
        one == 0.0, 0.0, np.log(2.0) + log_part
    )
    return np.asarray(np.sum(np.where(np.isnan(signs), 0.0, each), axis=1))


def log_mean(values: Sequence[float] | Sequence[Array] | Array) -> Array:
    """log of the mean of exp(values) along the first axis."""
    return np.asarray(np.logaddexp.reduce(values) - np.log(len(values)))


@dataclass(frozen=True, eq=False)
class LinearModel:
    """One hypothesis as a linear model.

    Attributes:
        columns: of the prediction / deviation, shape (channels, n, p); base, sizes, then its own.
        target: what the coefficients should reproduce, shape (channels, n).
        spread: prior standard deviations, shape (p,).
        signs: as `evidence` takes them, shape (p,).
        log: log evidence.
        mean: posterior, of the coefficients, shape (p,).
        covariance: the same, shape (p, p).
        noise: variance of each channel, shape (channels,).
    """

    columns: Array
    target: Array
    spread: Array
    signs: Array
    log_evidence: float
    mean: Array
    covariance: Array
    noise: Array

    def residual(self, first: int | None = None) -> Array:
        """What all coefficients, or the first ones alone, leave of the target, (channels, n)."""
        return np.asarray(self.target - self.columns[..., :first] @ self.mean[:first])

    @property
    def likelihoods(self) -> Array:
        """Posterior mean of the log likelihood of each sample, up to a constant, shape (n,).

        So the log evidence changes with the weight of a sample, the noise being where it is
        largest.
        """
        squares = self.residual() ** 2 + np.sum(
            (self.columns @ self.covariance) * self.columns, axis=-1
        )
        noise = self.noise[:, None]
        return np.asarray(-0.5 * np.sum(squares / noise + np.log(noise), axis=0))


def linear_models(
    observed: Observations, columns: Array, target: Array, spreads: Array, signs: Array
) -> list[LinearModel]:
    """Weigh the same columns under several priors, spreads of shape (m, p)."""
    one = gram(columns, target)
    found = model_evidence(
        np.broadcast_to(one, (len(spreads), *one.shape)),
        len(observed),
        spreads,
        observed.prior_dof,
        signs,
    )
    return [
        LinearModel(columns, target, spread, signs, float(log), mean, covariance, noise)
        for spread, log, mean, covariance, noise in zip(spreads, *found, strict=True)
    ]

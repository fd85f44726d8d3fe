# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Evidence of linear models with Gaussian priors and unknown noise of each channel.

Near its refit every hypothesis is linear: y = J t + e with t ~ N(0, S) and e_c ~ N(0, phi_c I) in
channel c. The noise variances phi_c have inverse-gamma priors with nu_c degrees of freedom around
what was stated, and are set to their posterior mode; t is integrated out:

.. math:: \log p(y) = -\tfrac12\sum_c\left[(n_c+\nu_c)\log\phi_c + \nu_c/\phi_c\right]
          -\tfrac12\left[\sum_c R_c/\phi_c + m^TS^{-1}m\right]
          -\tfrac12\log|S\,A|, \qquad A = \sum_c J_c^TJ_c/\phi_c + S^{-1}

(constants common to all hypotheses left out). m is the posterior mean of t, R_c the sum of squared
residuals. Only Gram matrices enter, so thousands of models over the same samples cost one product
each. See MacKay, *Bayesian interpolation* (1992), Neural Comput. 4, 415.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..observations import Observations
from ..settings import (
    AMPLITUDE_LOG_DEVIATION,
    AMPLITUDE_START,
    AMPLITUDE_TOLERANCE,
    FIXED_POINT_ROUNDS,
    MAX_AMPLITUDE_STEP,
    NOISE_TOLERANCE,
    ROUNDING,
)
from ..system import Array


class ModelEvidence(NamedTuple):
    """Evidence and posterior of m linear models.

    Attributes:
        log_evidence: up to a common constant [nats], shape (m,).
        mean: posterior mean of the coefficients, shape (m, p).
        covariance: posterior covariance of the coefficients, shape (m, p, p).
        noise: variance of each channel in units of the stated one, shape (m, channels).
    """

    log_evidence: Array
    mean: Array
    covariance: Array
    noise: Array


def gram(columns: Array, target: Array) -> Array:
    """Return Gram matrices of [columns, target] by channel.

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
    start_noise: Array | None = None,
    rounds: int = FIXED_POINT_ROUNDS,
) -> ModelEvidence:
    """Return the evidence and posterior of m linear models.

    Args:
        grams: of [columns, target], shape (m, channels, p + 1, p + 1).
        count: samples per channel; shape (m, 1) where the models have different ones.
        spread: prior standard deviations of the coefficients, shape (p,) or (m, p).
        prior_dof: prior degrees of freedom of the stated noise, shape (channels,).
        signs: of the coefficients that are sizes of effects and have a moment prior, as in
            `Hypothesis.signs`, shape (p,) or (m, p). If None no coefficient has one.
        start_noise: variance of each channel near the solution, shape (m, channels); that stated
            if None.
        rounds: most rounds of the fixed point of the noise.
    """
    square = grams[..., :-1, :-1]
    cross = grams[..., :-1, -1]
    total = grams[..., -1, -1]
    precision = spread**-2.0
    p = spread.shape[-1]
    diagonal = np.arange(p)
    flat_square = square.reshape(*total.shape, p * p)
    noise = np.ones(total.shape) if start_noise is None else start_noise
    # Fixed point of the noise variances, given the posterior of the coefficients.
    for _ in range(rounds):
        weights = 1.0 / noise[:, None]
        matrix = (weights @ flat_square).reshape(-1, p, p)
        matrix[:, diagonal, diagonal] += precision
        covariance, log_determinant = _inverse_and_log_determinant(matrix)
        mean = ((weights @ cross) @ covariance)[:, 0]
        # Squared residuals, from the Gram matrices alone, and how many coefficients determine them.
        change = (square @ mean[:, None, :, None])[..., 0] - 2.0 * cross
        squares = total + (change @ mean[..., None])[..., 0]
        fitted = (flat_square @ covariance.reshape(-1, p * p, 1))[..., 0] / noise
        previous = noise
        noise = (prior_dof + squares) / (prior_dof + count - fitted)
        if (np.abs(noise / previous - 1.0) < NOISE_TOLERANCE).all():
            break
    residual = np.maximum(squares, 1e-12)
    of_readings = np.sum(
        (count + prior_dof) * np.log(noise) + (prior_dof + residual) / noise, axis=1
    )
    of_prior = np.sum(precision * mean**2, axis=1)
    of_spread = 2.0 * np.sum(np.log(spread), axis=-1)
    log_evidence = -0.5 * (of_readings + of_prior + log_determinant + of_spread)
    if signs is not None:
        variance = np.diagonal(covariance, axis1=1, axis2=2)
        log_evidence += moment_prior_log_bayes_factor(mean, variance, spread, signs)
    return ModelEvidence(log_evidence, mean, covariance, noise)


def _inverse_and_log_determinant(matrices: Array) -> tuple[Array, Array]:
    """Return inverses and log determinants of positive definite matrices.

    Cholesky factors give both in half the time of `numpy.linalg.inv`, in which a diagnosis would
    spend a third of its time.

    Args:
        matrices: shape (m, p, p).

    Returns:
        Shapes (m, p, p) and (m,).
    """
    from scipy.linalg.lapack import dpotrf, dtrtri

    roots = np.empty_like(matrices)
    for i, matrix in enumerate(matrices):
        factor, failure = dpotrf(matrix)
        if failure:
            # Readings so exact that rounding hides the priors.
            inverses = np.asarray(np.linalg.inv(matrices), dtype=np.float64)
            return inverses, np.linalg.slogdet(matrices)[1]
        roots[i], _ = dtrtri(factor, overwrite_c=True)
    inverses = roots @ np.swapaxes(roots, 1, 2)
    diagonals = np.diagonal(roots, axis1=1, axis2=2)
    return inverses, -2.0 * np.sum(np.log(diagonals), axis=1)


def fitted_model(
    observed: Observations,
    columns: Array,
    target: Array,
    prior_spread: Array,
    group: NDArray[np.intp],
    start: tuple[Array, Array] | None = None,
) -> LinearModel:
    r"""Return a linear model whose groups of coefficients have fitted amplitudes.

    The coefficients of group g have the variances :math:`v_g s_j^2`, with
    :math:`\log v_g \sim N(0, \sigma^2)`. Each :math:`v_g` is set to its posterior mode (automatic
    relevance determination; MacKay 1992), which balances the effective number
    :math:`\gamma_g` of coefficients that the readings determine:

    .. math:: \tfrac12\sum_j \frac{m_j^2}{v_g s_j^2} - \tfrac12\gamma_g
              - \frac{\log v_g}{\sigma^2} = 0

    The log evidence includes the prior of each amplitude and the width of its mode (Laplace).

    Args:
        observed: the readings.
        columns: shape (channels, n, p).
        target: shape (channels, n).
        prior_spread: prior standard deviations s, shape (p,).
        group: number of the group of each coefficient, -1 for none, shape (p,).
        start: standard deviations of the coefficients, shape (p,), and noise, shape (channels,),
            near the solution; None where nothing is known.
    """
    grams = gram(columns, target)
    in_group = group >= 0
    numbers, first, index = np.unique(
        group[in_group], return_index=True, return_inverse=True
    )
    groups = len(numbers)
    members = np.equal.outer(index, np.arange(groups)).astype(np.float64)
    signs = np.full(len(prior_spread), np.nan)
    if start is None:
        # From small amplitudes the noise takes up the gap first, and keeps it.
        log_variance = np.full(groups, AMPLITUDE_START * AMPLITUDE_LOG_DEVIATION)
        noise = np.ones(len(grams))
    else:
        start_spread, noise = start
        amplitude = (start_spread / prior_spread)[in_group][first]
        log_variance = 2.0 * np.log(amplitude)
    log_posterior = -np.inf
    # One round of the noise for each of the amplitudes: both settle together.
    for _ in range(FIXED_POINT_ROUNDS):
        previous = log_posterior
        spread = prior_spread.copy()
        spread[in_group] *= np.exp(0.5 * log_variance[index])
        # Mean and covariance hold at this noise, not at the updated one.
        noise_of_round = noise
        log_evidence, mean, covariance, noise = _single_evidence(
            grams, len(observed), spread, observed.prior_dof, noise
        )
        of_prior = -0.5 * np.sum(log_variance**2) / AMPLITUDE_LOG_DEVIATION**2
        log_posterior = log_evidence + float(of_prior)
        # Coefficients of the groups in their prior deviations.
        deviation = spread[in_group]
        relative_mean = mean[in_group] / deviation
        relative = covariance[np.ix_(in_group, in_group)]
        relative = relative / np.outer(deviation, deviation)
        effective = (1.0 - np.diagonal(relative)) @ members
        if abs(log_posterior - previous) < AMPLITUDE_TOLERANCE:
            break
        log_variance = log_variance + _log_variance_step(
            log_variance, relative_mean, relative, members
        )
    of_width = -0.5 * np.sum(
        np.log1p(0.5 * effective.clip(0.0) * AMPLITUDE_LOG_DEVIATION**2)
    )
    return LinearModel(
        columns=columns,
        target=target,
        spread=spread,
        signs=signs,
        log_evidence=float(log_posterior + of_width),
        mean=mean,
        covariance=covariance,
        noise=noise_of_round,
        prior_spread=prior_spread,
        group=group,
    )


def _single_evidence(
    grams: Array, count: int, spread: Array, prior_dof: Array, start_noise: Array
) -> tuple[float, Array, Array, Array]:
    """Return `model_evidence` of one model."""
    posterior = model_evidence(
        grams[None], count, spread, prior_dof, start_noise=start_noise[None], rounds=1
    )
    log_evidence, mean, covariance, noise = (part[0] for part in posterior)
    return float(log_evidence), mean, covariance, noise


def _log_variance_step(
    log_variance: Array, mean: Array, covariance: Array, members: Array
) -> Array:
    r"""Return the Newton step to the modes of the log variances of all groups.

    With the coefficients m and their covariance C in units of their prior deviations, and
    :math:`T_g = \sum_j C_{jj}` of the :math:`n_g` coefficients of a group, the slope is
    :math:`\tfrac12(\sum_j m_j^2 - n_g + T_g) - \log v_g / \sigma^2`. As m and C change by
    :math:`C_h m` and :math:`C_h C`, with :math:`C_h` the columns of group h, its derivative is

    .. math:: \tfrac12\Bigl(-\delta_{gh}\bigl(\sum_j m_j^2 + T_g\bigr)
              + \sum_{ij} C_{ij}^2 + 2\sum_{ij} m_i C_{ij} m_j\Bigr) - \delta_{gh} / \sigma^2

    Where this is not negative definite, the step holds C and the other groups.

    Args:
        log_variance: before the step, shape (groups,).
        mean: of the coefficients in groups, in prior deviations, shape (k,).
        covariance: the same, shape (k, k).
        members: 1 where a coefficient is in a group, else 0, shape (k, groups).
    """
    prior_precision = AMPLITUDE_LOG_DEVIATION**-2.0
    squares = mean**2 @ members
    own = np.diagonal(covariance) @ members
    slope = 0.5 * (squares - members.sum(axis=0) + own)
    slope -= prior_precision * log_variance
    coupled = covariance**2 + 2.0 * mean[:, None] * covariance * mean
    curvature = np.diag(0.5 * (squares + own) + prior_precision)
    curvature -= 0.5 * (members.T @ coupled @ members)
    try:
        np.linalg.cholesky(curvature)
    except np.linalg.LinAlgError:
        step = slope / (0.5 * squares + prior_precision)
    else:
        step = np.linalg.solve(curvature, slope)
    return np.asarray(step.clip(-MAX_AMPLITUDE_STEP, MAX_AMPLITUDE_STEP))


def change_of_prior_scale(
    mean: Array, covariance: Array, spread: Array, others: Array, signs: Array
) -> Array:
    r"""Return the log Bayes factor of other prior scales against the one of a fitted model.

    Likelihood is posterior divided by prior. At the same noise the evidence under another prior is
    therefore exact, whatever the correlations: with precision :math:`P = C^{-1} - S^{-1} + S'^{-1}`

    .. math:: \log B = \tfrac12\left(m'^TC^{-1}m - m^TC^{-1}m + \log|C^{-1}| - \log|P|\right)
              + \sum_j \log\frac{s_j}{s'_j}, \qquad m' = P^{-1} C^{-1} m

    and the moment prior of the new scales added.

    Args:
        mean: posterior mean m of these coefficients, shape (..., k).
        covariance: their posterior covariance C, shape (..., k, k).
        spread: prior standard deviations s that they had, shape (k,).
        others: other prior standard deviations s', shape (m, k).
        signs: as in `moment_prior_log_bayes_factor`, shape (..., k). The fitted model has no moment
            prior for these coefficients.

    Returns:
        Shape (..., m).
    """
    old_precision = np.linalg.inv(covariance)
    pull = (old_precision @ mean[..., None])[..., 0]
    change_of_prior = others[..., None] ** -2.0 * np.eye(len(spread))
    change_of_prior -= np.diag(spread**-2.0)
    new_precision = old_precision[..., None, :, :] + change_of_prior
    new_covariance = np.linalg.inv(new_precision)
    new_mean = (new_covariance @ pull[..., None, :, None])[..., 0]
    log_new = np.linalg.slogdet(new_precision)[1]
    log_old = np.linalg.slogdet(old_precision)[1]
    of_old = np.sum(mean * pull, axis=-1) - log_old
    of_new = np.sum(new_mean * pull[..., None, :], axis=-1) - log_new
    new_variance = np.diagonal(new_covariance, axis1=-2, axis2=-1)
    return np.asarray(
        0.5 * (of_new - of_old[..., None])
        + np.sum(np.log(spread / others), axis=-1)
        + moment_prior_log_bayes_factor(
            new_mean, new_variance, others, signs[..., None, :]
        )
    )


def moment_prior_log_bayes_factor(
    mean: Array, variance: Array, spread: Array, signs: Array
) -> Array:
    r"""Return the log Bayes factor of a moment prior against the normal prior.

    An effect too small to matter is no cause, so the prior of a size vanishes at zero:
    :math:`p(a) = a^2 / s^2 \; N(a; 0, s^2)` (moment prior; Johnson & Rossell 2010, J. R. Stat.
    Soc. B 72, 143). Evidence against an effect that is absent then grows with the samples as
    fast as evidence for one that is present. A size of one sign has the prior of that side only.

    Args:
        mean: posterior mean under the normal prior, shape (..., p).
        variance: posterior variance of each coefficient, shape (..., p).
        spread: standard deviations s of the normal prior, shape (p,) or (..., p).
        signs: 1 or -1 for a size of one sign, 0 for a size of either sign, NaN for what is not a
            size, shape (p,) or (..., p).

    Returns:
        The sum over the sizes, shape (...,).
    """
    from scipy.special import erfcx, log_ndtr

    # Rounding may leave no variance at all to what the readings determine by far.
    variance = np.maximum(variance, np.square(ROUNDING * spread))
    deviation = np.sqrt(variance)
    sign = np.nan_to_num(signs)
    ratio = sign * mean / deviation
    # Log probability of the sign, and the hazard rate of the normal truncated to it.
    log_sign_probability = log_ndtr(ratio)
    hazard = np.sqrt(2.0 / np.pi) / erfcx(-ratio / np.sqrt(2.0))
    second_moment = mean**2 + variance + sign * mean * deviation * hazard
    log_moment = np.log(np.maximum(second_moment, 1e-300) / spread**2)
    log_side = np.where(sign == 0.0, 0.0, np.log(2.0) + log_sign_probability)
    log_factors = np.where(np.isnan(signs), 0.0, log_moment + log_side)
    return np.asarray(np.sum(log_factors, axis=-1))


def log_mean(values: Sequence[float] | Sequence[Array] | Array) -> Array:
    """Return the log of the mean of exp(values) along the first axis."""
    return np.asarray(np.logaddexp.reduce(values) - np.log(len(values)))


@dataclass(frozen=True, eq=False)
class LinearModel:
    """One hypothesis as a linear model, with its posterior.

    Attributes:
        columns: derivatives of prediction / deviation by the coefficients, shape (channels, n, p):
            base parameters, sizes and shapes first, then those of discrepancies.
        target: what the coefficients reproduce, shape (channels, n).
        spread: prior standard deviations, shape (p,).
        signs: as for `model_evidence`, shape (p,).
        log_evidence: up to a constant common to all models of the same readings [nats].
        mean: posterior mean of the coefficients, shape (p,).
        covariance: posterior covariance of the coefficients, shape (p, p).
        noise: variance of each channel in units of the stated one, shape (channels,).
        prior_spread: prior standard deviations before amplitudes were fitted, shape (p,); None
            where no amplitude was.
        group: as for `fitted_model`, shape (p,); None where no amplitude was fitted.
    """

    columns: Array
    target: Array
    spread: Array
    signs: Array
    log_evidence: float
    mean: Array
    covariance: Array
    noise: Array
    prior_spread: Array | None = None
    group: NDArray[np.intp] | None = None

    def residual(self, first: int | None = None) -> Array:
        """Return target minus fit, in deviations, shape (channels, n).

        Args:
            first: number of leading coefficients that are used; all if None.
        """
        return np.asarray(self.target - self.columns[..., :first] @ self.mean[:first])

    @cached_property
    def log_likelihoods(self) -> Array:
        """Posterior mean of the log likelihood of each sample, up to a constant, shape (n,).

        The derivative of the log evidence by the weight of the sample, since the noise is at its
        maximum.
        """
        variance = np.sum((self.columns @ self.covariance) * self.columns, axis=-1)
        squares = self.residual() ** 2 + variance
        noise = self.noise[:, None]
        return np.asarray(-0.5 * np.sum(squares / noise + np.log(noise), axis=0))


def linear_models(
    observed: Observations, columns: Array, target: Array, spreads: Array, signs: Array
) -> list[LinearModel]:
    """Return the linear models of the same columns under several priors.

    Args:
        observed: the readings.
        columns: shape (channels, n, p).
        target: shape (channels, n).
        spreads: prior standard deviations of each model, shape (m, p).
        signs: as for `model_evidence`, shape (p,).
    """
    one = gram(columns, target)
    grams = np.broadcast_to(one, (len(spreads), *one.shape))
    posterior = model_evidence(grams, len(observed), spreads, observed.prior_dof, signs)
    models = []
    for spread, log_evidence, mean, covariance, noise in zip(
        spreads, *posterior, strict=True
    ):
        models.append(
            LinearModel(
                columns,
                target,
                spread,
                signs,
                float(log_evidence),
                mean,
                covariance,
                noise,
            )
        )
    return models

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""The refit of a hypothesis to the bench.

Every hypothesis is refitted together with the base parameters: a few free parameters absorb most
of the signature of any effect, so a comparison at fixed base parameters would compare nothing.

A refit minimises

.. math:: \sum_c \frac{1}{\phi_c} \sum_i \left(\frac{y_{ci} - f_{ci}(\theta)}{s_{ci}}\right)^2
          + \sum_j \left(\frac{\theta_j - \mu_j}{\tau_j}\right)^2

within the bounds of theta. y are readings, s their stated standard deviations, phi the noise
variance of a channel in units of the stated one, mu and tau the prior means and deviations. Sizes
have no prior here, only bounds: their prior enters with the evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..observations import Observations
from ..settings import (
    AUXILIARY_VARIANCE_RATIO,
    BASE_DIFFERENCE,
    CONVERGED_STEP,
    INVISIBLE_SIGNATURE,
    NEGLIGIBLE_STEP,
    NO_ANSWER,
    REFIT_STEPS,
    ROUGH_REFIT_STEPS,
    SIGNATURE_SIZE,
    SIZE_DIFFERENCE,
    STEP_PARTS,
)
from ..system import Array, Case, Effect, Points, forms_of, predict_cases
from .hypothesis import Hypothesis

Signature = tuple[Effect, Array]
"""A form, and the change of prediction / deviation by one typical size, shape (channels, n)."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A refitted hypothesis.

    Attributes:
        hypothesis: what was refitted.
        observed: the readings it was refitted to.
        theta: fitted parameters, shape (p,).
        whitened: (measured - predicted) / deviation without the errors that readings share, shape
            (channels, n); `NO_ANSWER` where the model has none.
        jacobian: derivative of prediction / deviation by theta, shape (channels, n, p).
        noise: variance of each channel in units of the stated one, shape (channels,).
    """

    hypothesis: Hypothesis
    observed: Observations
    theta: Array
    whitened: Array
    jacobian: Array
    noise: Array

    @property
    def base(self) -> Array:
        """Scaled base parameters."""
        return self.theta[: len(self.hypothesis.system.base)]

    @property
    def base_and_shared(self) -> Array:
        """Scaled base parameters and errors that readings share."""
        return self.theta[: self.hypothesis.base_count]

    @property
    def with_shared_errors(self) -> Array:
        """Measured minus predicted, in deviations, with the errors that readings share in it.

        Shape (channels, n); `whitened` is without them.
        """
        shared = self.observed.shared_columns @ self.theta[self.hypothesis.shared]
        return np.where(self.whitened == NO_ANSWER, NO_ANSWER, self.whitened + shared)

    @property
    def sizes(self) -> Array:
        """Sizes of the effects, in typical sizes, shape (effects,)."""
        return self.theta[self.hypothesis.size_indices]

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects as fitted."""
        return self.hypothesis.effects_at(self.theta)

    @property
    def target(self) -> Array:
        """What a linear model near the refit has to reproduce, shape (channels, n).

        The whitened readings less the prediction extrapolated to the prior mean.
        """
        from_prior = self.theta - self.hypothesis.prior_mean
        return np.asarray(self.whitened + self.jacobian @ from_prior)

    @cached_property
    def nuisance_basis(self) -> Array:
        """Orthonormal basis of what a refit of the base parameters absorbs.

        It spans the columns of the Jacobian, divided by the noise, continued by one row for each
        prior. For a hypothesis without effects. Shape (channels x n + p, p).
        """
        scaled = self.jacobian / np.sqrt(self.noise)[:, None, None]
        readings = scaled.reshape(-1, len(self.theta))
        prior = np.diag(1.0 / self.hypothesis.base_spread)
        basis, _ = np.linalg.qr(np.concatenate([readings, prior]))
        return np.asarray(basis)

    def project_out(self, readings: Array, prior: Array | float = 0.0) -> Array:
        """Project the nuisance basis out of changes of the readings.

        Args:
            readings: changes in units of the noise, shape (k, channels, n).
            prior: changes of the prior rows, shape (k, p) or scalar.

        Returns:
            What a refit leaves, in the rows of `nuisance_basis`, shape (k, channels x n + p).
        """
        count = len(readings)
        prior_rows = np.broadcast_to(prior, (count, len(self.theta)))
        rows = np.concatenate([readings.reshape(count, -1), prior_rows], axis=1)
        return np.asarray(rows - rows @ self.nuisance_basis @ self.nuisance_basis.T)

    @cached_property
    def signatures(self) -> list[Signature]:
        """Every form of the library that is visible in the readings, with its signature."""
        forms: list[Effect] = []
        for effect in self.hypothesis.system.library:
            forms += forms_of(effect)
        visible = []
        for form, change in zip(forms, self.signatures_of(forms), strict=True):
            if np.abs(change).max() >= INVISIBLE_SIGNATURE:
                visible.append((form, change))
        return visible

    def signature(self, form: Effect) -> Array:
        """Return the signature of one further form, shape (channels, n)."""
        return np.asarray(self.signatures_of([form])[0])

    def signatures_of(self, forms: Sequence[Effect]) -> Array:
        """Return the changes of prediction / deviation by one typical size of further forms.

        Shape (forms, channels, n). A refit leaves little of an effect: the slope at a small size
        counts.
        """
        base, effects = self.hypothesis.case(self.theta)
        cases: list[Case] = []
        for form in forms:
            size = form.sizes()[0]
            values = {size.name: SIGNATURE_SIZE * size.typical}
            cases.append((base, (*effects, form.with_values(values))))
        with_form = _whitened_cases(self.hypothesis, self.observed, cases, self.theta)
        # Where the model with the effect has no answer there is no slope.
        change = np.where(with_form == NO_ANSWER, 0.0, self.whitened - with_form)
        return np.asarray(change / SIGNATURE_SIZE)

    def served_fit(self, noise: Array) -> Fit:
        """Return the refit whose model is served.

        The likeliest refit may give up a served channel to fit an auxiliary one to the last digit.
        Auxiliary channels therefore get a larger variance here, which absorbs the misfit of forms.

        Args:
            noise: variance of each channel without the misfit of forms, shape (channels,).
        """
        served = [channel.served for channel in self.observed.channels]
        if all(served):
            return self
        auxiliary = np.maximum(self.noise, AUXILIARY_VARIANCE_RATIO * noise)
        weights = np.where(served, noise, auxiliary)
        return refit(
            self.hypothesis,
            self.observed,
            self.theta,
            self.jacobian,
            whitened=self.whitened,
            noise=weights,
            negligible=CONVERGED_STEP,
        )

    def observations_at(self, points: Points) -> Observations:
        """Return the predicted readings at other points, with the noise of the campaign.

        Args:
            points: operating points, shape (n,) each.
        """
        observed = self.observed
        channels = observed.channels
        predicted = self.hypothesis.predict(self.theta, points, channels)
        rows = []
        for channel, row in zip(channels, predicted, strict=True):
            rows.append(channel.deviation(row))
        deviation = np.stack(rows)
        deviation[0] = np.median(observed.deviation[0])
        variation = self.hypothesis.local_variation(
            self.theta, points, channels, predicted
        )
        shared = np.sqrt(np.sum(observed.shared_columns**2, axis=-1))
        # A further test belongs to another session, whose errors are not known.
        of_session = deviation * np.median(shared, axis=1, keepdims=True)
        deviation = np.hypot(deviation * np.sqrt(self.noise)[:, None], of_session)
        no_errors = np.zeros((*predicted.shape, observed.shared_count))
        return replace(
            observed,
            points=points,
            measured=predicted,
            number=np.arange(predicted.shape[1]),
            deviation=np.hypot(deviation, variation),
            shared_errors=no_errors,
        )


# --- the refit ------------------------------------------------------------------------------


def refit(
    hypothesis: Hypothesis,
    observed: Observations,
    start: Array | None = None,
    slopes: Array | None = None,
    *,
    whitened: Array | None = None,
    rough: bool = False,
    noise: Array | None = None,
    negligible: float = NEGLIGIBLE_STEP,
) -> Fit:
    """Fit base parameters, sizes and free shapes within their bounds (Gauss-Newton).

    Steps update the Jacobian instead of taking it anew (Broyden 1965, Math. Comp. 19, 577). Where
    an updated Jacobian leads to no better point it is taken anew, and the refit ends where an exact
    one leads to none. The one returned is exact.

    Args:
        hypothesis: what is assumed.
        observed: the readings.
        start: theta to start from, or its first components; the prior mean if None.
        slopes: approximate `Fit.jacobian` at the start; taken by differences if None.
        whitened: residuals at the start, if it is within the bounds and they are known.
        rough: whether to end where an updated Jacobian leads to no better point, once a step has
            been made or if the next one is negligible.
        noise: variance of each channel by which it is weighed, shape (channels,); estimated from
            the residuals if None. `Fit.noise` of the result is estimated in either case.
        negligible: deviations by which a step has to change the prediction.
    """
    theta = _start(hypothesis, start)
    if whitened is None:
        whitened = _whitened(hypothesis, observed, theta)
    first = _Trial(theta, whitened)
    descent = _descend(hypothesis, observed, first, slopes, rough, noise, negligible)
    if not descent.is_exact:
        # A gap of a thousand deviations shows an error of a thousandth in its signature.
        jacobian = _jacobian(hypothesis, observed, descent.theta, descent.whitened)
        descent = descent._replace(jacobian=jacobian)
    variance = _noise(observed, descent.whitened, len(theta))
    if descent.is_stuck and start is not None and noise is None:
        better = restart_from_prior(hypothesis, observed, variance, rough)
        if better is not None:
            return better
    return Fit(
        hypothesis,
        observed,
        descent.theta,
        descent.whitened,
        descent.jacobian,
        variance,
    )


class _Descent(NamedTuple):
    """Where a descent ended.

    Attributes:
        theta: parameters, shape (p,).
        whitened: residuals, shape (channels, n).
        jacobian: as in `Fit`, shape (channels, n, p).
        is_exact: whether the Jacobian was taken there.
        is_stuck: whether no step was made because steps lose an answer.
    """

    theta: Array
    whitened: Array
    jacobian: Array
    is_exact: bool
    is_stuck: bool


def _descend(
    hypothesis: Hypothesis,
    observed: Observations,
    start: _Trial,
    slopes: Array | None,
    rough: bool,
    noise: Array | None,
    negligible: float,
) -> _Descent:
    """Make Gauss-Newton steps until none is better; arguments as of `refit`."""
    theta, whitened = start
    jacobian = slopes
    if jacobian is None:
        jacobian = _jacobian(hypothesis, observed, theta, whitened)
    is_exact = slopes is None
    has_moved = False
    for _ in range(ROUGH_REFIT_STEPS if rough else REFIT_STEPS):
        variance = noise
        if variance is None:
            variance = _noise(observed, whitened, len(theta))
        objective = _Objective(hypothesis, np.sqrt(variance)[:, None])
        columns = objective.columns(jacobian)
        aim = gauss_newton_aim(objective, columns, whitened, theta)
        is_negligible = np.linalg.norm(columns @ (aim - theta)) < negligible
        search = _NO_STEP
        if not is_negligible:
            search = line_search(objective, observed, theta, whitened, aim, negligible)
        if search.accepted is None:
            is_good_enough = rough and (is_negligible or has_moved)
            if is_exact or is_good_enough:
                is_stuck = search.lost_answer and not has_moved
                return _Descent(theta, whitened, jacobian, is_exact, is_stuck)
            jacobian = _jacobian(hypothesis, observed, theta, whitened)
            is_exact = True
            continue
        step = search.accepted.theta - theta
        change = whitened - search.accepted.whitened
        jacobian = broyden_update(jacobian, columns, step, change)
        theta, whitened = search.accepted
        is_exact = False
        has_moved = True
    return _Descent(theta, whitened, jacobian, is_exact, is_stuck=False)


class _Trial(NamedTuple):
    """Parameters, shape (p,), and whitened residuals there, shape (channels, n)."""

    theta: Array
    whitened: Array


class _LineSearch(NamedTuple):
    """Outcome of a line search.

    Attributes:
        accepted: the first point that is better, or None.
        lost_answer: whether a point tried has no answer for a reading that had one.
    """

    accepted: _Trial | None
    lost_answer: bool


_NO_STEP = _LineSearch(None, False)


class _Objective:
    """The least-squares problem of one step, at fixed noise variances."""

    def __init__(self, hypothesis: Hypothesis, noise_deviation: Array) -> None:
        """Prepare the problem.

        Args:
            hypothesis: what is fitted.
            noise_deviation: of each channel in units of the stated one, shape (channels, 1).
        """
        self.hypothesis = hypothesis
        self.noise_deviation = noise_deviation
        self.prior_mean = hypothesis.prior_mean
        # An infinite deviation gives sizes no prior.
        self.prior_rows = np.diag(1.0 / hypothesis.spread(np.inf))
        self.bounds = hypothesis.bounds

    def residuals(self, whitened: Array, theta: Array) -> Array:
        """Return residuals of the readings and of the priors, shape (channels x n + p,)."""
        of_priors = self.prior_rows @ (self.prior_mean - theta)
        return np.append(whitened / self.noise_deviation, of_priors)

    def columns(self, jacobian: Array) -> Array:
        """Return the derivatives of what is fitted, shape (channels x n + p, p)."""
        scaled = jacobian / self.noise_deviation[..., None]
        readings = scaled.reshape(-1, len(self.prior_mean))
        return np.concatenate([readings, self.prior_rows])


def gauss_newton_aim(
    objective: _Objective, columns: Array, whitened: Array, theta: Array
) -> Array:
    """Return the minimum of the linearised problem within the bounds, shape (p,)."""
    from scipy.optimize import lsq_linear

    target = objective.residuals(whitened, theta) + columns @ theta
    # The triangular factor has the same solution and far fewer rows.
    basis, triangle = np.linalg.qr(columns)
    solution = lsq_linear(triangle, basis.T @ target, objective.bounds, "bvls")
    return np.asarray(solution.x)


def line_search(
    objective: _Objective,
    observed: Observations,
    theta: Array,
    whitened: Array,
    aim: Array,
    negligible: float = NEGLIGIBLE_STEP,
) -> _LineSearch:
    """Try parts of a step until one reduces the sum of squares.

    Args:
        objective: of the step.
        observed: the readings.
        theta: where the step starts, shape (p,).
        whitened: residuals there, shape (channels, n).
        aim: where the whole step ends, shape (p,).
        negligible: as of `refit`; a reduction by less than its square is none.
    """
    unanswered = whitened == NO_ANSWER
    # An answer that is lost costs no less than the worst misfit.
    charge = max(NO_ANSWER, np.abs(whitened).max())

    def squares_at(whitened: Array, theta: Array) -> float:
        charged = np.where(whitened == NO_ANSWER, charge, whitened)
        return float(np.sum(objective.residuals(charged, theta) ** 2))

    sufficient = squares_at(whitened, theta) - negligible**2
    lost_answer = False
    # Cases solved together take hardly longer than one.
    for parts in (STEP_PARTS[:1], STEP_PARTS[1:]):
        step = np.outer(parts, aim - theta)
        # The solution of the linear problem may miss a bound by rounding.
        trials = (theta + step).clip(*objective.bounds)
        cases = [objective.hypothesis.case(trial) for trial in trials]
        of_trials = _whitened_cases(objective.hypothesis, observed, cases, trials)
        for trial, trial_whitened in zip(trials, of_trials, strict=True):
            if squares_at(trial_whitened, trial) <= sufficient:
                return _LineSearch(_Trial(trial, trial_whitened), lost_answer)
            newly_unanswered = (trial_whitened == NO_ANSWER) & ~unanswered
            lost_answer = lost_answer or bool(newly_unanswered.any())
    return _LineSearch(None, lost_answer)


def broyden_update(
    jacobian: Array, columns: Array, step: Array, change: Array
) -> Array:
    r"""Return the Jacobian that reproduces the change along a step (Broyden 1965).

    .. math:: J \leftarrow J + \frac{(\Delta f - J s)\, (A^T A s)^T}{s^T A^T A s}

    with A the columns of the least-squares problem, so that the update is smallest in the units in
    which the problem is solved.

    Args:
        jacobian: J, shape (channels, n, p).
        columns: A, shape (channels x n + p, p).
        step: s, shape (p,).
        change: of prediction / deviation along the step, shape (channels, n).
    """
    direction = columns.T @ columns @ step
    error = change - jacobian @ step
    return np.asarray(jacobian + error[..., None] * direction / (step @ direction))


def restart_from_prior(
    hypothesis: Hypothesis, observed: Observations, noise: Array, rough: bool
) -> Fit | None:
    """Refit from the prior mean, and return that refit if it leaves less noise.

    At the edge of what the model can answer a refit can be stuck: every step from its start loses
    an answer.

    Args:
        hypothesis: what is assumed.
        observed: the readings.
        noise: variance of each channel where the refit is stuck, shape (channels,).
        rough: as for `refit`.
    """
    other = refit(hypothesis, observed, rough=rough)
    if np.sum(np.log(other.noise / noise)) < 0.0:
        return other
    return None


def _start(hypothesis: Hypothesis, start: Array | None) -> Array:
    """Return theta to start from, within the bounds."""
    theta = hypothesis.prior_mean.copy()
    if start is not None:
        theta[: len(start)] = start
    return np.asarray(theta.clip(*hypothesis.bounds))


# --- refits from a refit --------------------------------------------------------------------


def with_free_shapes(fit: Fit, rough: bool = False) -> Fit:
    """Refit with the shapes of all effects free, from where a refit ended.

    Args:
        fit: the refit.
        rough: as of `refit`; otherwise the refit goes on until it has converged.
    """
    before = fit.hypothesis
    observed = fit.observed
    free = replace(before, effects=fit.effects, free_shapes=len(fit.effects))
    theta = free.theta(fit.base_and_shared)
    was_free = [True] * before.base_count
    for parameter in free.free_parameters:
        was_free.append(parameter in before.free_parameters)
    known = np.array(was_free)
    slopes = np.empty((*fit.whitened.shape, len(theta)))
    slopes[..., known] = fit.jacobian
    slopes[..., ~known] = _jacobian(
        free, observed, theta, fit.whitened, np.flatnonzero(~known).tolist()
    )
    negligible = NEGLIGIBLE_STEP if rough else CONVERGED_STEP
    return refit(
        free,
        observed,
        theta,
        slopes,
        whitened=fit.whitened,
        rough=rough,
        negligible=negligible,
    )


def refit_without(fit: Fit, i: int) -> Fit:
    """Refit roughly without the effect of an index, from where a refit ended."""
    before = fit.hypothesis
    is_kept = [True] * before.base_count
    for effect_index, _ in before.free_parameters:
        is_kept.append(effect_index != i)
    kept = np.array(is_kept)
    free_shapes = before.free_shapes
    if i < free_shapes:
        free_shapes -= 1
    rest = replace(
        before,
        effects=(*fit.effects[:i], *fit.effects[i + 1 :]),
        free_shapes=free_shapes,
    )
    return refit(
        rest, fit.observed, fit.theta[kept], fit.jacobian[..., kept], rough=True
    )


def linearise(
    hypothesis: Hypothesis, observed: Observations, theta: Array, noise: Array
) -> Fit:
    """Return a fit at given parameters, also at points it was not fitted to.

    Args:
        hypothesis: whose prediction is linearised.
        observed: the readings.
        theta: parameters, shape (p,).
        noise: variance of each channel, shape (channels,).
    """
    whitened = _whitened(hypothesis, observed, theta)
    jacobian = _jacobian(hypothesis, observed, theta, whitened)
    return Fit(hypothesis, observed, theta, whitened, jacobian, noise)


# --- residuals and derivatives --------------------------------------------------------------


def _noise(observed: Observations, whitened: Array, parameters: int) -> Array:
    """Return the variance of each channel from its residuals and its statement.

    The posterior mode of a variance with an inverse-gamma prior; the parameters take their degrees
    of freedom from all channels alike. Shape (channels,).
    """
    prior_dof = observed.prior_dof
    n = len(observed)
    used = min(parameters, n - 1) / len(prior_dof)
    degrees_of_freedom = prior_dof + max(n - used, 1.0)
    return np.asarray((prior_dof + np.sum(whitened**2, axis=1)) / degrees_of_freedom)


def _whitened(hypothesis: Hypothesis, observed: Observations, theta: Array) -> Array:
    """Return (measured - predicted) / deviation, shape (channels, n)."""
    case = hypothesis.case(theta)
    return np.asarray(_whitened_cases(hypothesis, observed, [case], theta)[0])


def _whitened_cases(
    hypothesis: Hypothesis, observed: Observations, cases: Sequence[Case], theta: Array
) -> Array:
    """Return (measured - predicted) / deviation of many cases, shape (cases, channels, n).

    Args:
        hypothesis: whose system predicts.
        observed: the readings.
        cases: base parameters and effects.
        theta: parameters, of which the shared errors count, of all cases, shape (p,), or of each,
            shape (cases, p).
    """
    if not cases:
        return np.empty((0, *observed.measured.shape))
    predicted = predict_cases(hypothesis.system, cases, observed.points)
    of_channels = predicted[:, hypothesis.rows_of(observed.channels)]
    whitened = (observed.measured - of_channels) / observed.deviation
    if hypothesis.shared_count:
        shared = np.atleast_2d(theta)[:, hypothesis.shared]
        whitened -= np.tensordot(shared, observed.shared_columns, axes=(1, 2))
    return np.nan_to_num(whitened, nan=NO_ANSWER)


def _jacobian(
    hypothesis: Hypothesis,
    observed: Observations,
    theta: Array,
    whitened: Array,
    which: Sequence[int] | None = None,
) -> Array:
    """Return derivatives of prediction / deviation by differences.

    Args:
        hypothesis: what is fitted.
        observed: the readings.
        theta: parameters, shape (p,).
        whitened: residuals there, shape (channels, n).
        which: indices of theta; all if None.

    Returns:
        Shape (channels, n, parameters asked for).
    """
    indices = range(len(theta)) if which is None else which
    highest = hypothesis.bounds[1]
    unanswered = whitened == NO_ANSWER
    jacobian = np.empty((*whitened.shape, len(indices)))
    shared = hypothesis.shared
    moved_columns: list[int] = []
    steps: list[float] = []
    cases: list[Case] = []
    for column, i in enumerate(indices):
        if shared.start <= i < shared.stop:
            of_shared = observed.shared_columns[..., i - shared.start]
            jacobian[..., column] = np.where(unanswered, 0.0, of_shared)
            continue
        step = BASE_DIFFERENCE if i < hypothesis.base_count else SIZE_DIFFERENCE
        moved = theta.copy()
        moved[i] += step if theta[i] + step <= highest[i] else -step
        moved_columns.append(column)
        steps.append(moved[i] - theta[i])
        cases.append(hypothesis.case(moved))
    moved_whitened = _whitened_cases(hypothesis, observed, cases, theta)
    # Where an answer appears or is lost there is no slope.
    comparable = (moved_whitened == NO_ANSWER) == unanswered
    change = np.where(comparable, whitened - moved_whitened, 0.0)
    slopes = change / np.array(steps)[:, None, None]
    jacobian[..., moved_columns] = np.moveaxis(slopes, 0, -1)
    return jacobian

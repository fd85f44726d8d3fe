# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Explanations of the readings: sets of effects, discrepancies, or the base model alone.

Each explanation is refitted, or linear near a refit, and has an evidence. No model is exact:
explanations with effects include an allowance for an inexact base model and for inexact forms.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..detection.regions import Regions
from ..fitting.evidence import (
    LinearModel,
    change_of_prior_scale,
    linear_models,
    log_mean,
)
from ..fitting.refit import Fit, linearise, refit
from ..observations import Observations
from ..settings import (
    BASE_AMPLITUDE_LIMIT,
    EXPLAINED_BY_SET,
    EXTRA_DISCREPANCY_FRACTION,
    FORM_ALLOWANCES,
    INTERVAL_DEVIATIONS,
    MIN_FORM_ERROR_MATCH,
    MISSED_FRACTION,
    NO_ANSWER,
    OTHER_FORM_FRACTION,
    PRIOR_DOF_ASSUMED,
    PRIOR_DOF_ASSUMED_SMALL,
    PRIOR_DOF_STATED,
    ROUNDING,
    SCATTERED_FRACTION,
    SIZE_SPREADS,
    WITHIN_CLASS_DEVIATIONS,
)
from ..system import Array, Effect
from .discrepancy import Columns, Discrepancy, allowed_columns, base_discrepancy
from .families import select_families
from .prediction import Prediction


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation.

    Attributes:
        fit: the refit near which it is linear.
        model: the linear model with its most likely allowances, at the widest prior of its sizes.
            Coefficients in order: theta, `families` of the base discrepancy and of the form
            discrepancies, `discrepancy`.
        plain_model: without allowances, at the most likely prior of its sizes. Coefficients in
            order: theta, `discrepancy`.
        log_evidence: averaged over the prior scales, and over the families of allowances [nats].
        discrepancy: a discrepancy in addition to the effects, or None.
        families: numbers of the families of `allowed_columns` that are likeliest to be present.
        form_error: name of the effect that is no cause but a form error of the others; empty
            for none.
        absent: names of the effects that are no causes: their size is zero within its error, or
            that of a meter within its class.
        has_excess_noise: whether noise above its statement is an unlisted loss.
    """

    fit: Fit
    model: LinearModel
    plain_model: LinearModel
    log_evidence: float
    discrepancy: Discrepancy | None = None
    families: tuple[int, ...] = ()
    form_error: str = ""
    has_excess_noise: bool = False
    absent: tuple[str, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the effects that are causes, sorted."""
        no_causes = (self.form_error, *self.absent)
        effects = self.fit.hypothesis.effects
        return tuple(
            sorted(item.name for item in effects if item.name not in no_causes)
        )

    @property
    def theta_covariance(self) -> Array:
        """Covariance of base parameters, sizes and free shapes, as in theta, shape (p, p)."""
        count = len(self.fit.theta)
        return np.asarray(self.plain_model.covariance[:count, :count])

    @property
    def parameter_covariance(self) -> Array:
        """Covariance of base parameters and sizes, with that of free shapes in it, shape (p, p)."""
        return np.asarray(self.plain_model.covariance[self._of_parameters])

    @property
    def may_be_zero(self) -> NDArray[np.bool_]:
        """Whether the size of each effect is zero within its error at the fitted shapes.

        With shapes free, the size of a clear loss could take any value that keeps the loss.
        """
        variance = np.diagonal(self.covariance_at_fitted_shapes)
        errors = np.sqrt(variance[self.fit.hypothesis.base_count :])
        return np.asarray(np.abs(self.fit.sizes) <= INTERVAL_DEVIATIONS * errors)

    @cached_property
    def covariance_at_fitted_shapes(self) -> Array:
        """Covariance of base parameters and sizes at the fitted shapes, shape (p, p).

        A further discrepancy is held as well.
        """
        information = np.linalg.inv(self.plain_model.covariance)
        return np.asarray(np.linalg.inv(information[self._of_parameters]))

    @property
    def _of_parameters(self) -> tuple[NDArray[np.intp], ...]:
        """Where a covariance of theta holds base parameters and sizes."""
        hypothesis = self.fit.hypothesis
        kept = [*range(hypothesis.base_count), *hypothesis.size_indices]
        return np.ix_(kept, kept)

    @property
    def parameter_errors(self) -> Array:
        """Standard errors of base parameters and sizes, shape (p,)."""
        return np.sqrt(np.diagonal(self.parameter_covariance))

    @property
    def size_errors(self) -> Array:
        """Standard errors of the sizes, in typical sizes, shape (effects,)."""
        return self.parameter_errors[self.fit.hypothesis.base_count :]

    @cached_property
    def served_fit(self) -> Fit:
        """The refit whose model is served."""
        return self.fit.served_fit(self.model.noise)

    @property
    def is_listed_set(self) -> bool:
        """Whether it is listed effects with the signs they have, and no discrepancy."""
        return (
            bool(self.names)
            and self.discrepancy is None
            and not self.has_excess_noise
            and not self.fit.hypothesis.reversed_sign
        )

    @property
    def is_base_discrepancy(self) -> bool:
        """Whether it is a base model that is a little off and nothing else."""
        if self.fit.hypothesis.effects or self.discrepancy is None:
            return False
        if not self.discrepancy.is_base:
            return False
        return not self._far_off(self._base_spread(self.discrepancy.families))

    def _base_spread(self, families: Sequence[int] | None) -> Array:
        """Return the prior deviations of the coefficients of a base discrepancy.

        Args:
            families: that it has; None for all.
        """
        of_base, spread = base_discrepancy(self.fit.observed)
        if families is None:
            return spread
        return np.asarray(spread[np.isin(of_base.family, families)])

    def _far_off(self, spread: Array) -> list[int]:
        """Return the coefficients of a base discrepancy that is more than a little off.

        Args:
            spread: prior deviations of its coefficients, which follow theta.
        """
        begin = len(self.fit.theta)
        amplitude = self.model.spread[begin : begin + len(spread)] / spread
        return (begin + np.flatnonzero(amplitude > BASE_AMPLITUDE_LIMIT)).tolist()

    def explained_fraction(self, base_only: Explanation) -> float:
        """Return how far the listed effects explain the gap, 0 to 1.

        Three fractions of the squared change from the base model reduce it: what an extra
        discrepancy makes, what scatters above its statement, and what the set misses while its
        forms have no error. Up to a limit each stays unexplained without a doubt about the set: it
        is due to inexact forms, or too small beside the change.

        Args:
            base_only: the base model alone.
        """
        if not self.names or self.fit.hypothesis.reversed_sign:
            return 0.0
        extra, missed = self._fractions_not_explained(base_only)
        explained = np.interp(extra, EXTRA_DISCREPANCY_FRACTION, EXPLAINED_BY_SET)
        explained *= np.interp(missed, MISSED_FRACTION, EXPLAINED_BY_SET)
        if self.has_excess_noise:
            scattered = self._scattered_fraction(base_only)
            explained *= np.interp(scattered, SCATTERED_FRACTION, EXPLAINED_BY_SET)
        return float(explained)

    def _scattered_fraction(self, base_only: Explanation) -> float:
        """Return the fraction of the squared gap that is scatter above its statement, 0 to 1.

        It does not depend on the number of samples: both grow with them alike.

        Args:
            base_only: the base model alone.
        """
        squares = np.mean(base_only.fit.whitened**2, axis=1)
        is_stated = self.fit.observed.prior_dof > PRIOR_DOF_ASSUMED_SMALL
        excess = np.where(is_stated, np.maximum(self.model.noise - 1.0, 0.0), 0.0)
        gap = max(float(np.sum(squares)), ROUNDING)
        return min(float(np.sum(excess)) / gap, 1.0)

    def makes_most_of_change(self, base_only: Explanation) -> bool:
        """Whether the listed effects make most of the squared change from the base model.

        What scatters along no axis and what an extra discrepancy makes are no part of it.

        Args:
            base_only: the base model alone.
        """
        before = np.sum(base_only.fit.whitened**2)
        left = np.sum(self.fit.whitened**2)
        noise = float(base_only.fit.whitened.size)
        reduced = (before - left) / max(before - noise, 1.0)
        extra, _ = self._fractions_not_explained(base_only)
        return bool(min(reduced, 1.0 - extra) >= OTHER_FORM_FRACTION)

    def _fractions_not_explained(self, base_only: Explanation) -> tuple[float, float]:
        """Return the fractions of the squared change by an extra discrepancy, and by form errors.

        A base model that is more than a little off is an extra discrepancy. What the set misses
        has two measures, of which the smaller counts: the fraction that the errors of its forms
        make, and that of the reduction of squares that it does not reach alone.

        Args:
            base_only: the base model alone.
        """
        theta_count = len(self.fit.theta)
        extra_count = self.plain_model.columns.shape[-1] - theta_count
        allowance_end = self.model.columns.shape[-1] - extra_count
        base_spread = self._base_spread(self.families)
        forms_begin = theta_count + len(base_spread)
        far_off = self._far_off(base_spread)

        # Residuals in units of the noise, as more and more of the explanation is added.
        deviation = np.sqrt(self.model.noise)[:, None]
        base = base_only.fit.whitened / deviation
        set_alone = self.plain_model.residual(theta_count) / deviation
        with_base_allowance = self.model.residual(forms_begin) / deviation
        with_form_errors = self.model.residual(allowance_end) / deviation
        complete = self.model.residual() / deviation

        remaining = np.sum(complete**2)
        total_change = np.sum((base - complete) ** 2) + ROUNDING
        reduction = max(np.sum(base**2) - remaining, ROUNDING)
        of_far_off = self.model.columns[..., far_off] @ self.model.mean[far_off]
        extra = with_form_errors - complete + of_far_off / deviation
        of_extra = np.sum(extra**2) / total_change
        of_forms = np.sum((with_base_allowance - with_form_errors) ** 2) / total_change
        not_reduced = (np.sum(set_alone**2) - remaining) / reduction
        return float(of_extra), float(min(of_forms, not_reduced))

    def prediction_at(
        self, points: Observations, with_allowances: bool = False
    ) -> Prediction:
        """Return the posterior predictive at points, those of the campaign or others.

        Args:
            points: where; the mean is relative to `points.measured`.
            with_allowances: whether base and forms may be a little off.
        """
        fit = self.fit
        at_points = fit
        if points is not fit.observed:
            at_points = linearise(fit.hypothesis, points, fit.theta, fit.noise)
        model = self.model if with_allowances else self.plain_model
        columns = at_points.jacobian
        if with_allowances and fit.hypothesis.effects:
            allowed = allowed_columns(at_points, fit.observed, 1.0)
            columns = allowed.of_families(self.families).columns
        # The prediction is of the machine: errors of meters are no part of it.
        columns = columns.copy()
        columns[..., fit.hypothesis.shared] = 0.0
        if self.discrepancy is not None:
            of_discrepancy = self.discrepancy.columns(points)
            columns = np.concatenate([columns, of_discrepancy], axis=-1)
        # The refit itself is the plain prediction of an explanation without a discrepancy.
        change = np.zeros(len(model.mean))
        if with_allowances or self.discrepancy is not None:
            change = model.mean.copy()
            change[: len(fit.theta)] -= fit.theta - fit.hypothesis.prior_mean
        no_answer = (at_points.whitened == NO_ANSWER).any(axis=0)
        mean = columns @ change - at_points.with_shared_errors
        return Prediction(np.where(no_answer, np.nan, mean), columns, model.covariance)


# --- the base model, and sets of effects ----------------------------------------------------


def explain_by_base(base: Fit) -> Explanation:
    """Return the refitted base model as an explanation."""
    spread = base.hypothesis.base_spread
    (model,) = linear_models(
        base.observed, base.jacobian, base.target, spread[None], base.hypothesis.signs
    )
    return Explanation(base, model, model, model.log_evidence)


def explain(fit: Fit) -> Explanation:
    """Return the explanation of a refitted set of effects, with its allowances.

    Its evidence is the sum over the families of the allowances, times the mean over the prior
    scales of the sizes with the likeliest families.
    """
    observed = fit.observed
    signs = fit.hypothesis.signs
    sizes = fit.hypothesis.size_indices
    allowed = allowed_columns(fit, observed, max(SIZE_SPREADS))
    optional = np.unique(allowed.group[allowed.group >= 0])
    selection = select_families(observed, allowed, fit.target, optional)
    # The moment prior enters with the scale of the sizes.
    scales = _size_scales(fit)
    changes = _change_of_size_priors(selection.model, sizes, scales, signs[sizes])
    plain_spread = fit.hypothesis.spread(scales[int(changes.argmax())])
    (plain_model,) = linear_models(
        observed, fit.jacobian, fit.target, plain_spread[None], signs
    )
    return Explanation(
        fit,
        selection.model,
        plain_model,
        selection.log_evidence + float(log_mean(changes)),
        families=selection.families,
    )


def _size_scales(fit: Fit) -> Array:
    """Return the prior scales of the sizes in every combination, shape (m, sizes)."""
    count = len(fit.hypothesis.size_indices)
    return np.array(list(itertools.product(SIZE_SPREADS, repeat=count)))


def _change_of_size_priors(
    model: LinearModel, sizes: NDArray[np.intp], scales: Array, signs: Array
) -> Array:
    """Return the log Bayes factor of other priors of the sizes against the widest, shape (m,).

    Args:
        model: with the sizes at the widest prior.
        sizes: indices of their coefficients, k of them.
        scales: prior deviations of the sizes, shape (m, k).
        signs: as for `change_of_prior_scale`, shape (k,).
    """
    return change_of_prior_scale(
        model.mean[sizes],
        model.covariance[np.ix_(sizes, sizes)],
        np.full(len(sizes), max(SIZE_SPREADS)),
        scales,
        signs,
    )


def without_absent(explanation: Explanation) -> Explanation:
    """Return an explanation in which no effect is a cause that is zero, or an error of a meter.

    Its size is zero within its error at the fitted shapes, or it joins others and is within the
    class of the meter.
    """
    fit = explanation.fit
    is_zero = explanation.may_be_zero
    absent = []
    of_meters = []
    for effect, zero in zip(fit.effects, is_zero.tolist(), strict=True):
        if zero:
            absent.append(effect.name)
        elif _is_within_class(effect, fit.observed):
            of_meters.append(effect.name)
    # What is all of a gap is more than its meter explains.
    if len(absent) + len(of_meters) < len(fit.effects):
        absent += of_meters
    return replace(explanation, absent=tuple(absent))


def _is_within_class(effect: Effect, observed: Observations) -> bool:
    """Return whether an effect is no larger than the error of a meter that readings share."""
    named = getattr(effect, "shared_error", "")
    deviations = [
        item.deviation for item in observed.shared_names if item.name == named
    ]
    if not deviations:
        return False
    size = effect.values()[effect.sizes()[0].name]
    return abs(size) <= WITHIN_CLASS_DEVIATIONS * max(deviations)


def with_form_errors(explanation: Explanation) -> list[Explanation]:
    """Return explanations in which one effect is a form error of the forms of the others.

    No form is exact, and what one misses may look like another effect. The prior of that size is
    then the allowance for forms, of either sign, in place of the moment prior of a cause.

    Args:
        explanation: of listed effects, with or without a discrepancy.

    Returns:
        One for each effect that may be a form error of the others.
    """
    fit = explanation.fit
    changes = fit.jacobian[..., fit.hypothesis.size_indices]
    changes = changes / np.sqrt(fit.noise)[:, None, None]
    explanations = []
    for i, effect in enumerate(fit.hypothesis.effects):
        is_other = np.arange(len(fit.sizes)) != i
        of_others = changes[..., is_other] @ fit.sizes[is_other]
        of_effect = changes[..., i]
        if _may_be_form_error(of_effect, of_others):
            ratio = float(np.linalg.norm(of_others) / np.linalg.norm(of_effect))
            log_evidence = _log_evidence_of_form_error(explanation, i, ratio)
            explanations.append(
                replace(explanation, log_evidence=log_evidence, form_error=effect.name)
            )
    return explanations


def _may_be_form_error(of_effect: Array, of_others: Array) -> bool:
    """Whether a change of the readings is other changes times a factor at each sample.

    The factor is one for all channels: a bent leak still changes speed and torque as a leak does.

    Args:
        of_effect: in deviations, shape (channels, n).
        of_others: the same.
    """
    squares = np.sum(of_others**2, axis=0)
    products = np.sum(of_others * of_effect, axis=0)
    alike = np.sum(products[squares > 0.0] ** 2 / squares[squares > 0.0])
    return bool(alike > MIN_FORM_ERROR_MATCH * np.sum(of_effect**2))


def _log_evidence_of_form_error(
    explanation: Explanation, form_error: int, ratio: float
) -> float:
    """Return the log evidence with one effect as a form error of the forms of the others.

    Args:
        explanation: with that effect as a cause.
        form_error: index of the effect.
        ratio: its size that changes the readings as much as all others together.
    """
    hypothesis = explanation.fit.hypothesis
    sizes = hypothesis.size_indices
    model = explanation.model
    signs = hypothesis.signs[sizes]
    scales = _size_scales(explanation.fit)
    of_cause = log_mean(_change_of_size_priors(model, sizes, scales, signs))
    signs_with_form_error = np.where(np.arange(len(sizes)) == form_error, np.nan, signs)
    choices: list[tuple[float, ...]] = [SIZE_SPREADS] * len(sizes)
    choices[form_error] = tuple(part * ratio for part in FORM_ALLOWANCES)
    scales_with_form_error = np.array(list(itertools.product(*choices)))
    of_form_error = log_mean(
        _change_of_size_priors(
            model, sizes, scales_with_form_error, signs_with_form_error
        )
    )
    return explanation.log_evidence + float(of_form_error - of_cause)


def explain_exactly(fit: Fit) -> Explanation:
    """Return the explanation of a refit continued with an exact Jacobian."""
    exact = refit(fit.hypothesis, fit.observed, fit.theta, whitened=fit.whitened)
    return explain(exact)


# --- discrepancies --------------------------------------------------------------------------


def with_smooth_discrepancy(
    explanation: Explanation, discrepancy: Discrepancy, spread: Array
) -> Explanation:
    """Return an explanation extended by a smooth discrepancy of fitted amplitudes.

    Args:
        explanation: to extend.
        discrepancy: the addition.
        spread: prior standard deviations of its coefficients, shape (m,).
    """
    observed = explanation.fit.observed
    target = explanation.model.target
    further = Columns(discrepancy.columns(observed), spread, discrepancy.family)
    known = _columns_of(explanation.model)
    columns = known.with_further(further)
    optional = np.unique(columns.group[len(known.group) :])
    selection = select_families(
        observed, columns, target, optional, least=1, known=explanation.model
    )
    is_present = np.isin(optional, selection.families)
    present = tuple(np.unique(further.group)[is_present].tolist())

    plain_model = explanation.plain_model
    of_present = further.of_families(present)
    plain = _columns_of(plain_model).with_further(of_present)
    extended_plain_model = replace(
        plain.fitted(observed, target),
        signs=np.append(plain_model.signs, np.full(len(of_present.spread), np.nan)),
    )
    # What the priors of sizes and allowances change, they change here too.
    of_priors = explanation.log_evidence - explanation.model.log_evidence
    return replace(
        explanation,
        model=selection.model,
        plain_model=extended_plain_model,
        log_evidence=selection.log_evidence + of_priors,
        discrepancy=replace(discrepancy, families=present),
    )


def _columns_of(model: LinearModel) -> Columns:
    """Return the columns of a linear model, with amplitudes that are not fitted yet."""
    if model.prior_spread is None or model.group is None:
        return Columns(model.columns, model.spread, np.full(len(model.spread), -1))
    return Columns(model.columns, model.prior_spread, model.group)


def scattered(explanation: Explanation) -> list[Explanation]:
    """Return an explanation with an unlisted loss that varies along no recorded axis.

    Such a loss shows as noise. Its variance has then the prior of a noise that is not stated, in
    place of the statement. It is in one of the channels whose noise is stated, equally likely.

    Args:
        explanation: to extend; the result is empty where no noise is stated.
    """
    prior_dof = explanation.fit.observed.prior_dof
    is_stated = prior_dof > PRIOR_DOF_ASSUMED_SMALL
    if not is_stated.any():
        return []
    noise = np.maximum(explanation.model.noise[is_stated], 1.0)
    # However well it was stated, conditions of a campaign differ from those of the statement.
    stated = np.minimum(prior_dof[is_stated], PRIOR_DOF_STATED)
    gains = _log_density_of_noise(noise, np.asarray(PRIOR_DOF_ASSUMED))
    gains -= _log_density_of_noise(noise, stated)
    log_evidence = explanation.log_evidence + float(log_mean(gains))
    return [replace(explanation, log_evidence=log_evidence, has_excess_noise=True)]


def _log_density_of_noise(noise: Array, prior_dof: Array) -> Array:
    """Return the log density of the log of a noise variance, scaled inverse chi squared.

    Args:
        noise: in units of the stated variance.
        prior_dof: its prior degrees of freedom.
    """
    from scipy.special import gammaln

    half = 0.5 * prior_dof
    log_norm = half * np.log(half) - gammaln(half)
    return np.asarray(log_norm - half * (np.log(noise) + 1.0 / noise))


def explain_by_base_discrepancy(base_only: Explanation) -> Explanation:
    """Return the explanation of a base model that is a little off and nothing else."""
    discrepancy, spread = base_discrepancy(base_only.fit.observed)
    return with_smooth_discrepancy(base_only, discrepancy, spread)


def smooth_discrepancies(explanation: Explanation) -> list[Explanation]:
    """Return an explanation with a smooth unlisted discrepancy, once for each channel."""
    observed = explanation.fit.observed
    extended = []
    for i, channel in enumerate(observed.channels):
        scale = float(np.median(channel.field_spreads))
        discrepancy = Discrepancy(observed, (i,))
        spread = discrepancy.prior([scale])
        extended.append(with_smooth_discrepancy(explanation, discrepancy, spread))
    return extended


def with_box(
    explanation: Explanation, discrepancy: Discrepancy, scales: Sequence[float]
) -> Explanation:
    """Return an explanation extended by a discrepancy inside a box, averaged over its priors.

    Args:
        explanation: to extend.
        discrepancy: the addition.
        scales: prior standard deviations of the step, equally likely.
    """
    models = _stepped(explanation.model, explanation, discrepancy, scales)
    plain_models = _stepped(explanation.plain_model, explanation, discrepancy, scales)
    gains = [model.log_evidence for model in models]
    best = int(np.argmax(gains))
    of_sizes = explanation.log_evidence - _at_fitted_amplitudes(explanation)
    return replace(
        explanation,
        model=models[best],
        plain_model=plain_models[best],
        log_evidence=float(log_mean(gains)) + of_sizes,
        discrepancy=discrepancy,
    )


def _at_fitted_amplitudes(explanation: Explanation) -> float:
    """Return the log evidence of the model of an explanation, its amplitudes held."""
    model = explanation.model
    (held,) = linear_models(
        explanation.fit.observed,
        model.columns,
        model.target,
        model.spread[None],
        model.signs,
    )
    return held.log_evidence


def _stepped(
    model: LinearModel,
    explanation: Explanation,
    discrepancy: Discrepancy,
    scales: Sequence[float],
) -> list[LinearModel]:
    """Return a linear model of an explanation with a step, under each prior of the step."""
    observed = explanation.fit.observed
    further = discrepancy.columns(observed)
    rows = [np.append(model.spread, scale) for scale in scales]
    return linear_models(
        observed,
        np.concatenate([model.columns, further], axis=-1),
        model.target,
        np.stack(rows),
        np.append(model.signs, np.nan),
    )


def boxed_discrepancies(explanation: Explanation, boxes: Regions) -> list[Explanation]:
    """Return an explanation with an unlisted discrepancy inside the best box and channel.

    The boxes are compared at the noise that the explanation leaves; the best one is evaluated in
    full. The evidence is the mean over all boxes and channels.

    Args:
        explanation: to extend.
        boxes: where the discrepancy may lie; the result is empty if there are none.
    """
    observed = explanation.fit.observed
    if not len(boxes):
        return []
    gains = []
    for i in range(len(observed.channels)):
        gains.append(_box_gains(explanation.model, observed, i, boxes))
    best_channel, best_box = divmod(int(np.argmax(gains)), len(boxes))
    limits = _open_at_the_edge(boxes.low[best_box], boxes.high[best_box], observed)
    channel = observed.channels[best_channel]
    best = with_box(
        explanation,
        Discrepancy(observed, (best_channel,), limits),
        channel.step_spreads,
    )
    mean_against_best = float(log_mean(np.ravel(gains)) - np.max(gains))
    return [replace(best, log_evidence=best.log_evidence + mean_against_best)]


def _box_gains(
    model: LinearModel, observed: Observations, channel: int, boxes: Regions
) -> Array:
    """Return the gain in log evidence by a constant discrepancy inside each box.

    With the column u of a box, P the projection that the model leaves, r its residuals, all in
    units of the noise, and a prior variance s^2 of the coefficient: (u'r)^2 / (u'Pu) is the squared
    signal, which the prior shrinks.

    Args:
        model: to extend.
        observed: the readings.
        channel: index of the channel with the discrepancy.
        boxes: where it may lie.

    Returns:
        Shape (boxes,), averaged over the prior scales.
    """
    unit = observed.unit_discrepancy[channel]
    weighted = unit / model.noise[:, None]
    # Sums over all channels at once: a box holds a sample or not, whatever the channel.
    with_columns = boxes.members @ np.einsum("cn,cn...->n...", weighted, model.columns)
    with_itself = boxes.members @ np.einsum("cn,cn...->n...", weighted, unit)
    with_residual = boxes.members @ np.einsum(
        "cn,cn...->n...", weighted, model.residual()
    )
    absorbed = np.sum(with_columns @ model.covariance * with_columns, axis=1)
    squares = np.maximum(with_itself - absorbed, ROUNDING * with_itself)
    spreads = observed.channels[channel].step_spreads
    ratios = np.square(spreads)[:, None] * squares
    signal = with_residual**2 / squares * ratios / (1.0 + ratios)
    return log_mean(0.5 * (signal - np.log1p(ratios)))


def _open_at_the_edge(low: Array, high: Array, observed: Observations) -> Array:
    """Return the limits of a box, infinite where they are the edge of the campaign.

    Args:
        low: lower limits, shape (axes,).
        high: upper limits, shape (axes,).
        observed: the campaign.

    Returns:
        Shape (2, axes).
    """
    lowest = observed.coordinates.min(axis=1)
    highest = observed.coordinates.max(axis=1)
    open_low = np.where(low <= lowest, -np.inf, low)
    open_high = np.where(high >= highest, np.inf, high)
    return np.stack([open_low, open_high])

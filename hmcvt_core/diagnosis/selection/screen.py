# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The linear screen: which forms, added to a refit, gain most evidence."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fitting.evidence import (
    change_of_prior_scale,
    gram,
    linear_models,
    log_mean,
    model_evidence,
)
from ..fitting.hypothesis import Hypothesis
from ..fitting.refit import Fit, Signature, refit
from ..settings import EQUAL_EVIDENCE, SIZE_SPREADS
from ..system import Array, Effect

MAX_GRAM_NUMBERS = 1_000_000
"""Numbers in the Gram matrices that are computed at a time, 8 MB.

Limit of memory: thousands of pairs of forms at once take gigabytes, and no less time.
"""
Names = tuple[str, ...]
"""Names of effects."""
Combination = tuple[int, ...]
"""Indices of forms that are added together."""


@dataclass(frozen=True)
class LogFormPrior:
    """Log of the mean likelihood over the forms of some effects against the best form.

    Forms of one effect are equally likely before any bench. A set is refitted with its best form,
    so its evidence is reduced by this, the price of the choice.

    Attributes:
        all_forms: over all forms.
        fixed_parts: over what remains to choose once shapes are free, each at its best shapes: the
            form, and the shapes that are never free.
    """

    all_forms: float = 0.0
    fixed_parts: float = 0.0

    def times(self, other: LogFormPrior) -> LogFormPrior:
        """Return the log form prior of the effects of both."""
        return LogFormPrior(
            self.all_forms + other.all_forms, self.fixed_parts + other.fixed_parts
        )

    def once_free(self) -> LogFormPrior:
        """Return the log form prior once the shapes have been fitted."""
        return LogFormPrior(self.fixed_parts, self.fixed_parts)


class Proposal(NamedTuple):
    """Forms added to a refit, in linear approximation.

    Attributes:
        gain: in log evidence, against the refit.
        start: the refit that forms are added to.
        effects: all forms, those of the start first.
        changes: signatures of the added forms, shape (channels, n) each.
        log_form_prior: of the added forms.
    """

    gain: float
    start: Fit
    effects: tuple[Effect, ...]
    changes: tuple[Array, ...]
    log_form_prior: LogFormPrior

    def refit(self, reversed_sign: bool = False) -> Fit:
        """Refit roughly from where the start ended."""
        hypothesis = replace(
            self.start.hypothesis, effects=self.effects, reversed_sign=reversed_sign
        )
        added = np.stack(self.changes, axis=-1)
        slopes = np.concatenate([self.start.jacobian, added], axis=-1)
        # From sizes of zero no step leaves more than the start had left.
        theta = np.append(self.start.theta, np.zeros(len(self.changes)))
        return refit(
            hypothesis,
            self.start.observed,
            theta,
            slopes,
            whitened=self.start.whitened,
            rough=True,
        )


def screen(
    fit: Fit, library: Sequence[Signature], count: int = 1, reversed_sign: bool = False
) -> list[Proposal]:
    """Return forms added to a refit, by their gain in log evidence, best first.

    Args:
        fit: the refit; forms of effects that it has are left out.
        library: the forms with their signatures.
        count: how many forms of different effects are added at a time.
        reversed_sign: whether their sizes have the sign they cannot have; effects of either sign
            are then left out.
    """
    candidates = _candidates(fit, library, reversed_sign)
    forms = tuple(form for form, _ in candidates)
    combinations = _combinations(forms, count)
    if not combinations:
        return []
    changes = np.stack([change for _, change in candidates], axis=-1)
    gains = _gains(fit, forms, changes, combinations, reversed_sign)
    log_form_priors = _log_form_priors(forms, combinations, gains.tolist())
    proposals = []
    # A stable sort in steps of equal evidence: equal forms come in the order of the library.
    steps = np.round(gains / EQUAL_EVIDENCE)
    for i in np.argsort(-steps, kind="stable"):
        combination = combinations[i]
        proposals.append(
            Proposal(
                float(gains[i]),
                fit,
                (*fit.hypothesis.effects, *(forms[j] for j in combination)),
                tuple(candidates[j][1] for j in combination),
                log_form_priors[_names(forms, combination)],
            )
        )
    return proposals


def _candidates(
    fit: Fit, library: Sequence[Signature], reversed_sign: bool
) -> list[Signature]:
    """Return the forms of the library that can be added to a refit."""
    present = {effect.name for effect in fit.hypothesis.effects}
    candidates = []
    for form, change in library:
        has_either_sign = form.sizes()[0].low < 0.0
        if form.name in present or (reversed_sign and has_either_sign):
            continue
        candidates.append((form, change))
    return candidates


def _combinations(forms: Sequence[Effect], count: int) -> list[Combination]:
    """Return the combinations of so many forms of different effects."""
    combinations = []
    for combination in itertools.combinations(range(len(forms)), count):
        if len(set(_names(forms, combination))) == count:
            combinations.append(combination)
    return combinations


def _names(forms: Sequence[Effect], combination: Combination) -> Names:
    """Return the names of a combination, in the order of the library."""
    return tuple(forms[i].name for i in combination)


def _gains(
    fit: Fit,
    forms: tuple[Effect, ...],
    changes: Array,
    combinations: Sequence[Combination],
    reversed_sign: bool,
) -> Array:
    """Return the gain in log evidence of each combination, averaged over the prior scales.

    Args:
        fit: the refit that forms are added to.
        forms: candidates.
        changes: their signatures, shape (channels, n, forms).
        combinations: of them.
        reversed_sign: as for `screen`.

    Returns:
        Shape (combinations,).
    """
    observed = fit.observed
    hypothesis = fit.hypothesis
    theta_count = len(fit.theta)
    count = len(combinations[0])
    spread = hypothesis.spread(float(np.median(SIZE_SPREADS)))
    (without,) = linear_models(
        observed, fit.jacobian, fit.target, spread[None], hypothesis.signs
    )
    # Columns of all models: theta of the refit, then the forms of the combination.
    of_refit = np.tile(np.arange(theta_count), (len(combinations), 1))
    columns = np.concatenate([of_refit, theta_count + np.array(combinations)], axis=1)
    widest = np.full(count, max(SIZE_SPREADS))
    all_columns = np.concatenate([fit.jacobian, changes], axis=-1)
    whole = gram(all_columns, fit.target)
    signs_of_all = np.append(hypothesis.signs, np.full(count, np.nan))
    log_evidences = []
    means = []
    covariances = []
    for part in _parts(columns, len(observed.channels)):
        # The moment prior of the forms enters with the scale of their sizes, below.
        posterior = model_evidence(
            _grams(whole, part),
            len(observed),
            np.append(spread, widest),
            observed.prior_dof,
            signs_of_all,
            np.tile(without.noise, (len(part), 1)),
        )
        log_evidences.append(posterior.log_evidence)
        means.append(posterior.mean[:, theta_count:])
        # A copy: a view would keep the covariances of all coefficients.
        covariances.append(posterior.covariance[:, theta_count:, theta_count:].copy())
    of_forms = Hypothesis(hypothesis.system, forms, reversed_sign)
    signs = of_forms.signs[of_forms.base_count :][np.array(combinations)]
    change = change_of_prior_scale(
        np.concatenate(means),
        np.concatenate(covariances),
        widest,
        np.tile(np.array(SIZE_SPREADS)[:, None], count),
        signs,
    )
    gain = np.concatenate(log_evidences) - without.log_evidence
    return gain + log_mean(change.T)


def _parts(columns: NDArray[np.intp], channels: int) -> Iterator[NDArray[np.intp]]:
    """Yield the models in parts whose Gram matrices fit into a cache.

    Args:
        columns: indices of the columns of each model, shape (m, p).
        channels: number of channels.
    """
    of_model = channels * (columns.shape[1] + 1) ** 2
    size = max(1, MAX_GRAM_NUMBERS // of_model)
    for start in range(0, len(columns), size):
        yield columns[start : start + size]


def _grams(whole: Array, columns: NDArray[np.intp]) -> Array:
    """Return the Gram matrices of many models, picked from one of all columns.

    Args:
        whole: Gram matrices of the columns of the refit, of all forms and of the target, shape
            (channels, k + 1, k + 1).
        columns: indices of the columns of each model among the k columns, shape (m, p).

    Returns:
        Of [columns, target], shape (m, channels, p + 1, p + 1).
    """
    target = np.full((len(columns), 1), whole.shape[-1] - 1)
    picked = np.append(columns, target, axis=1)
    row_index = picked[:, :, None]
    column_index = picked[:, None, :]
    by_channel = whole[:, row_index, column_index]
    return np.moveaxis(by_channel, 0, 1)


def _log_form_priors(
    forms: Sequence[Effect], combinations: Sequence[Combination], gains: Sequence[float]
) -> dict[Names, LogFormPrior]:
    """Return the log form prior of each set of names.

    Args:
        forms: candidates.
        combinations: of them.
        gains: log evidence of each combination.
    """
    fixed = [_fixed_part(form) for form in forms]
    # For each set of names, the gains of the combinations that differ in free shapes only.
    grouped: dict[Names, dict[Any, list[float]]] = {}
    for combination, gain in zip(combinations, gains, strict=True):
        by_fixed_part = grouped.setdefault(_names(forms, combination), {})
        fixed_part = tuple(fixed[i] for i in combination)
        by_fixed_part.setdefault(fixed_part, []).append(gain)
    log_form_priors = {}
    for names, by_fixed_part in grouped.items():
        every = list(itertools.chain(*by_fixed_part.values()))
        best_of_fixed_parts = [max(values) for values in by_fixed_part.values()]
        best = max(best_of_fixed_parts)
        log_form_priors[names] = LogFormPrior(
            all_forms=float(log_mean(every) - best),
            fixed_parts=float(log_mean(best_of_fixed_parts) - best),
        )
    return log_form_priors


def _fixed_part(form: Effect) -> tuple[Any, ...]:
    """Return what refits do not change of a form: its name, and shapes that cannot be free."""
    values = form.values()
    shapes = []
    for item in form.parameters():
        if not (item.is_size or item.bends):
            shapes.append(values[item.name])
    return (form.form, *shapes)

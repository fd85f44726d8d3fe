# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The linear screen: which forms, added to a refit, gain most evidence."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..fitting.evidence import gram, linear_models, log_mean, model_evidence
from ..fitting.hypothesis import Hypothesis
from ..fitting.refit import Fit, Signature, refit
from ..settings import SCREENED_SPREAD, SIZE_SPREADS
from ..system import Array, Effect


class Proposal(NamedTuple):
    """Forms that may explain the readings, as the linear approximation has it.

    Attributes:
        gain: in log evidence.
        start: the refit that forms are added to.
        effects: all forms, those of the start first; `changes` of the prediction by the others.
        price: log of the mean against the best, over all forms of these names, and over those that
            remain once their shapes are free, shape (2,).
    """

    gain: float
    start: Fit
    effects: tuple[Effect, ...]
    changes: tuple[Array, ...]
    price: Array

    def refit(self, reversed_sign: bool = False) -> Fit:
        """Refit roughly from where the start ended."""
        hypothesis = replace(
            self.start.hypothesis, effects=self.effects, reversed_sign=reversed_sign
        )
        slopes = np.concatenate(
            [self.start.jacobian, np.stack(self.changes, axis=-1)], axis=-1
        )
        # Sizes of zero: the steps then never leave what the start had reached.
        start = np.append(self.start.theta, np.zeros(len(self.changes)))
        return refit(hypothesis, self.start.observed, start, slopes, rough=True)


def screen(
    fit: Fit, library: Sequence[Signature], count: int = 1, reversed_sign: bool = False
) -> list[Proposal]:
    """Weigh some forms of different names added to a refit, in linear approximation, best first.

    Args:
        fit: what they are added to, without names that it has.
        library: the forms.
        count: how many at a time.
        reversed_sign: with the wrong sign; effects that have either sign are left out.
    """
    hypothesis, names = (
        fit.hypothesis,
        {effect.name for effect in fit.hypothesis.effects},
    )
    kept = [
        (form, change)
        for form, change in library
        if form.name not in names and not (reversed_sign and form.sizes()[0].low < 0.0)
    ]
    forms = tuple(form for form, _ in kept)
    combined = [
        chosen
        for chosen in itertools.combinations(range(len(forms)), count)
        if len({forms[i].name for i in chosen}) == count
    ]
    if not combined:
        return []
    observed, own = fit.observed, len(fit.theta)
    which = np.concatenate(
        [np.tile(np.arange(own), (len(combined), 1)), own + np.array(combined)], axis=1
    )
    changes = np.stack([change for _, change in kept], axis=-1)
    whole = gram(np.concatenate([fit.jacobian, changes], axis=-1), fit.target)
    with_target = np.append(which, np.full((len(which), 1), own + len(forms)), axis=1)
    grams = np.moveaxis(
        whole[:, with_target[:, :, None], with_target[:, None, :]], 0, 1
    )
    added = Hypothesis(hypothesis.system, forms, reversed_sign)
    signs = np.append(hypothesis.signs, added.signs[hypothesis.base_count :])[which]
    spread = hypothesis.spread(SCREENED_SPREAD)
    (without,) = linear_models(
        observed, fit.jacobian, fit.target, spread[None], hypothesis.signs
    )
    found = [
        model_evidence(
            grams,
            len(observed),
            np.append(spread, np.full(count, scale)),
            observed.prior_dof,
            signs,
        )
        for scale in SIZE_SPREADS
    ]
    log = log_mean([each.log_evidence for each in found]) - without.log_evidence
    # Members of one set come in the order of the library.
    kinds = [tuple(forms[i].name for i in chosen) for chosen in combined]
    fixed = list(map(_fixed, forms))
    of_kind: dict[tuple[str, ...], dict[Any, list[float]]] = {}
    for chosen, kind, value in zip(combined, kinds, log.tolist(), strict=True):
        of_kind.setdefault(kind, {}).setdefault(
            tuple(fixed[i] for i in chosen), []
        ).append(value)
    price = {
        kind: np.array(
            [
                log_mean(list(itertools.chain(*values.values()))),
                log_mean(list(map(max, values.values()))),
            ]
        )
        - max(map(max, values.values()))
        for kind, values in of_kind.items()
    }
    return [
        Proposal(
            float(log[i]),
            fit,
            (*hypothesis.effects, *(forms[j] for j in combined[i])),
            tuple(kept[j][1] for j in combined[i]),
            price[kinds[i]],
        )
        for i in np.argsort(-log)
    ]


def _fixed(form: Effect) -> tuple[Any, ...]:
    """What refits do not change of a form: its name and the shapes that do not bend."""
    return (
        form.form,
        *(
            form.values()[item.name]
            for item in form.parameters()
            if not (item.is_size or item.bends)
        ),
    )

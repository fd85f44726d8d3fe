# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What may explain the readings: sets of known effects, losses that nobody listed, or nothing.

Each rival is refitted, or linear near a refit, and weighed by its evidence. No model is exact: with
effects come an allowance for forms that are a little off, and one for a base that is.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

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
    EXACT_BASE_SPREAD,
    EXPLAINED_BY_SET,
    EXTRA_DISCREPANCY_PART,
    FORM_ALLOWANCES,
    LEAST_SQUARE_PART,
    MISSED_PART,
    NO_ANSWER,
    SIZE_SPREADS,
)
from ..system import Array
from .discrepancy import Discrepancy, allowance_columns, base_discrepancy
from .prediction import Prediction


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation.

    Attributes:
        fit: the refit near which it is linear.
        model: the linear model with its most likely allowances, at the widest prior of its sizes.
        plain_model: without allowances, at their most likely prior.
        log_evidence: log evidence over the prior scales.
        discrepancy: a loss that nobody listed, or None.
    """

    fit: Fit
    model: LinearModel
    plain_model: LinearModel
    log_evidence: float
    discrepancy: Discrepancy | None = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Effect names, sorted."""
        return tuple(sorted(effect.name for effect in self.fit.hypothesis.effects))

    @cached_property
    def served_fit(self) -> Fit:
        """The refit that is handed over."""
        return self.fit.served_fit(self.model.noise)

    @property
    def is_listed_set(self) -> bool:
        """Whether it is known effects with the signs they have, and nothing beside them."""
        return (
            bool(self.names)
            and self.discrepancy is None
            and not self.fit.hypothesis.reversed_sign
        )

    def explained_fraction(self, bare: Explanation) -> float:
        """How far known effects with the signs they have are all of it, 0 to 1.

        Less by a loss beside them that is more than their forms may miss, and by what the set
        misses by itself while its forms bend for it.
        """
        if not self.names or self.fit.hypothesis.reversed_sign:
            return 0.0
        model, observed, own = self.model, self.fit.observed, len(self.fit.theta)
        known = own + len(observed.channels) * len(
            observed.smooth[1]
        )  # and a misfit of the base
        bent = (
            own + model.columns.shape[-1] - self.plain_model.columns.shape[-1]
        )  # all but a loss beside
        root = np.sqrt(model.noise)[:, None]
        start, left, unlost, unbent, alone = (
            rows / root
            for rows in (
                bare.fit.whitened,
                model.residual(),
                model.residual(bent),
                model.residual(known),
                self.plain_model.residual(own),
            )
        )
        every = np.sum((start - left) ** 2) + LEAST_SQUARE_PART
        gone = max(np.sum(start**2) - np.sum(left**2), LEAST_SQUARE_PART)
        lost = np.sum((unlost - left) ** 2) / every
        missed = min(
            np.sum((unbent - unlost) ** 2) / every,
            (np.sum(alone**2) - np.sum(left**2)) / gone,
        )
        return float(
            np.interp(lost, EXTRA_DISCREPANCY_PART, EXPLAINED_BY_SET)
            * np.interp(missed, MISSED_PART, EXPLAINED_BY_SET)
        )

    @property
    def is_base(self) -> bool:
        """Whether it is a base model that is a little off and nothing else."""
        return (
            not self.names and self.discrepancy is not None and self.discrepancy.is_base
        )

    def prediction_at(
        self, points: Observations, with_allowances: bool = False
    ) -> Prediction:
        """What it foretells of points, those of the campaign or others.

        Plainly, or with the allowances for forms and a base that are a little off.
        """
        model = self.model if with_allowances else self.plain_model
        there = (
            self.fit
            if points is self.fit.observed
            else linearise(self.fit.hypothesis, points, self.fit.theta, self.fit.noise)
        )
        columns, change = there.jacobian, np.zeros(len(model.mean))
        if with_allowances and self.names:
            columns = allowance_columns(there, self.fit.observed)
        if self.discrepancy is not None:
            columns = np.concatenate(
                [columns, self.discrepancy.columns(points)], axis=-1
            )
        if with_allowances or self.discrepancy is not None:
            change = model.mean.copy()
            change[: len(self.fit.theta)] -= (
                self.fit.theta - self.fit.hypothesis.prior_mean
            )
        refused = (there.whitened == NO_ANSWER).any(axis=0)
        return Prediction(
            np.where(refused, np.nan, columns @ change - there.whitened),
            columns,
            model.covariance,
        )


def explain_by_base(base: Fit) -> Explanation:
    """The refitted base model."""
    spread = base.hypothesis.system.base.spread
    (plain,) = linear_models(
        base.observed, base.jacobian, base.target, spread[None], base.hypothesis.signs
    )
    return Explanation(base, plain, plain, plain.log_evidence)


def explain(fit: Fit) -> Explanation:
    """Weigh a refit with its allowances."""
    observed, hypothesis = fit.observed, fit.hypothesis
    sizes, k = hypothesis.size_indices, len(fit.sizes)
    off, columns = base_discrepancy(observed)[1], allowance_columns(fit, observed)
    bends = columns.shape[-1] - len(fit.theta) - len(off)  # of k forms together
    each = np.full(bends, np.sqrt(len(observed.coordinates) * k / max(bends, 1)))
    widest = np.full(k, max(SIZE_SPREADS))
    spreads = np.stack(
        [
            np.concatenate([hypothesis.spread(widest), misfitting, allowance * each])
            for allowance in FORM_ALLOWANCES
            for misfitting in (off, np.full(len(off), EXACT_BASE_SPREAD))
        ]
    )
    tried = linear_models(
        observed, columns, fit.target, spreads, np.full(len(spreads[0]), np.nan)
    )
    scales = np.array(list(itertools.product(SIZE_SPREADS, repeat=k)))
    signs = hypothesis.signs
    logs = np.array(
        [
            item.log_evidence
            + change_of_prior_scale(
                item.mean[sizes],
                item.covariance[np.ix_(sizes, sizes)],
                widest,
                scales,
                signs[sizes],
            )
            for item in tried
        ]
    )
    best, scale = np.unravel_index(int(logs.argmax()), logs.shape)
    (plain,) = linear_models(
        observed,
        fit.jacobian,
        fit.target,
        hypothesis.spread(scales[scale])[None],
        signs,
    )
    return Explanation(fit, tried[best], plain, float(log_mean(logs.ravel())))


def explain_exactly(fit: Fit) -> Explanation:
    """Weigh a refit with slopes taken there, not mended on the way."""
    return explain(refit(fit.hypothesis, fit.observed, fit.theta))


def with_discrepancy(
    rival: Explanation, loss: Discrepancy, spreads: Iterable[Array]
) -> Explanation:
    """Weigh a rival with a loss beside it, under several priors."""
    observed, found = rival.fit.observed, []
    for model in (rival.model, rival.plain_model):
        columns = np.concatenate([model.columns, loss.columns(observed)], axis=-1)
        found.append(
            linear_models(
                observed,
                columns,
                model.target,
                np.stack([np.append(model.spread, spread) for spread in spreads]),
                np.append(
                    model.signs, np.full(columns.shape[-1] - len(model.signs), np.nan)
                ),
            )
        )
    best = int(np.argmax([item.log_evidence for item in found[0]]))
    return Explanation(
        rival.fit,
        found[0][best],
        found[1][best],
        float(log_mean([item.log_evidence for item in found[0]])),
        loss,
    )


def explain_by_base_discrepancy(bare: Explanation) -> Explanation:
    """Weigh a base model that is a little off and nothing else."""
    loss, spread = base_discrepancy(bare.fit.observed)
    return with_discrepancy(bare, loss, [spread])


def smooth_discrepancies(rival: Explanation) -> list[Explanation]:
    """Weigh a smooth loss that nobody listed beside a rival, channel by channel."""
    observed = rival.fit.observed
    losses = [
        (Discrepancy(observed, (i,)), channel)
        for i, channel in enumerate(observed.channels)
    ]
    return [
        with_discrepancy(
            rival, loss, [loss.spread(scale) for scale in channel.field_spreads]
        )
        for loss, channel in losses
    ]


def boxed_discrepancies(rival: Explanation, boxes: Regions) -> list[Explanation]:
    """Weigh a loss inside any box beside a rival; `log` is over all boxes, the rest of the best.

    The boxes are compared at the noise that the rival leaves, the best is weighed in full.
    """
    observed, model = rival.fit.observed, rival.model
    if not len(boxes):
        return []
    noise, gains = model.noise[:, None], []
    left = model.residual()
    for unit, channel in zip(observed.unit_discrepancy, observed.channels, strict=True):
        # Over all channels at once: a box holds or does not hold a sample.
        shadow, whole, pull = (
            boxes.members @ np.einsum("cn,cn...->n...", unit / noise, each)
            for each in (model.columns, unit, left)
        )
        squares = np.maximum(  # of what the rival leaves; all but none at least
            whole - np.sum(shadow @ model.covariance * shadow, axis=1),
            LEAST_SQUARE_PART * whole,
        )
        ratios = np.square(channel.step_spreads)[:, None] * squares
        gains.append(
            log_mean(
                0.5 * (pull**2 / squares * ratios / (1.0 + ratios) - np.log1p(ratios))
            )
        )
    best, box = divmod(int(np.argmax(gains)), len(boxes))
    # An edge of the campaign is none of the place.
    ends = observed.coordinates.min(axis=1), observed.coordinates.max(axis=1)
    low = np.where(boxes.low[box] <= ends[0], -np.inf, boxes.low[box])
    high = np.where(boxes.high[box] >= ends[1], np.inf, boxes.high[box])
    found = with_discrepancy(
        rival,
        Discrepancy(observed, (best,), np.stack([low, high])),
        [np.array([scale]) for scale in observed.channels[best].step_spreads],
    )
    return [
        replace(
            found,
            log_evidence=found.log_evidence
            + float(log_mean(np.ravel(gains)) - np.max(gains)),
        )
    ]

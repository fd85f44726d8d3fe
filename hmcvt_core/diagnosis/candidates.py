# SPDX-License-Identifier: Apache-2.0
"""The competitors for a gap, as linear models near their refits, and their evidence.

Three kinds compete: every form of every known effect (with an allowance for a form that is a
little off), a loss that nobody listed (a smooth field, or a step inside a region), and nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model.model import EfficiencyModel
from ..physics.effects import library
from ..physics.effects.base import Effect
from .basis import smooth_functions
from .evidence import Evidence, evidence, gram, log_mean, one_sided
from .hypothesis import (
    BASE_MEAN,
    BASE_SIZE,
    BASE_SPREAD,
    NUISANCES,
    Fit,
    Hypothesis,
    forms_of,
    nuisance_columns,
    predict,
    refit,
    to_base,
)
from .observations import Observations
from .regions import Regions

Array = NDArray[np.float64]

SIZE_SPREADS = (0.5, 1.5, 5.0)
"""Prior standard deviations of a size, in typical sizes; equally likely."""

FORM_ALLOWANCES = (0.07, 0.25)
"""How far a form may bend, smoothly over the working space, as a part of its own signature."""

_ALLOWED_DEGREE = 2
_FIELD_DEGREE = 3
_FIELD_SPREADS = (0.003, 0.01, 0.03)  # of the efficiency
_SPEED_SPREADS = (0.001, 0.004, 0.016)  # of the output speed, relative
_STEP_SPREADS = (0.01, 0.03)
_UNSEEN = 1e-3  # deviations: an effect this small at typical size has no channel to show in
_SCREENED_SIZE = 0.1  # in typical sizes
_SHARED = BASE_SIZE + len(NUISANCES)


@dataclass(frozen=True, eq=False)
class Linear:
    """One hypothesis as a linear model.

    Attributes:
        columns: of the prediction / deviation, shape (channels, n, p); base, nuisances, then its
            own.
        target: what the coefficients should reproduce, shape (channels, n).
        spread: prior standard deviations, shape (p,).
        positive: index of a coefficient that cannot be negative, or None.
        log: log evidence.
        found: posterior of the coefficients.
    """

    columns: Array
    target: Array
    spread: Array
    positive: int | None
    log: float
    found: Evidence


@dataclass(frozen=True, eq=False)
class Candidate:
    """One form of one effect (or of several), refitted.

    Attributes:
        effects: with fitted sizes.
        fit: the refit.
        linear: the linear model at the refit with bends of the form, at its most likely prior
            scale: what is weighed.
        plain: the same without bends: what the saved model predicts.
        log: log evidence over the prior scales.
    """

    effects: tuple[Effect, ...]
    fit: Fit
    linear: Linear
    plain: Linear
    log: float

    @property
    def names(self) -> tuple[str, ...]:
        """Effect names."""
        return tuple(effect.name for effect in self.effects)


class Bench:
    """Everything about one campaign that the competitors share."""

    def __init__(
        self, model: EfficiencyModel, observed: Observations, fitted: bool = True
    ) -> None:
        self.model, self.observed = model, observed
        start = Hypothesis(model)
        # A plan has nothing to be fitted to: its base parameters are those of the model.
        self.base = refit(start, observed, BASE_MEAN if fitted else to_base(model.parameters),
                          noise=None if fitted else np.ones(len(observed.channels)),
                          steps=25 if fitted else 0)
        self.nuisance = nuisance_columns(
            start.model_at(self.base.base, np.empty(0)), observed)
        self.count = len(observed.samples)
        self.channels = len(observed.channels)
        self.bends, _ = smooth_functions(observed.samples, _ALLOWED_DEGREE)

    # --- shared pieces ------------------------------------------------------------------------

    def target(self, fit: Fit) -> Array:
        """Linear target at a refit: residual plus what its own coefficients explain."""
        own = np.concatenate([fit.base - BASE_MEAN, fit.nuisance])
        return np.asarray(fit.whitened + fit.jacobian[..., :_SHARED] @ own)

    def shared(self, fit: Fit) -> tuple[Array, Array]:
        """Columns and prior of base parameters and nuisances."""
        spread = np.concatenate([BASE_SPREAD, np.ones(len(NUISANCES))])
        return fit.jacobian[..., :_SHARED], spread

    def weigh(
        self, columns: Array, target: Array, spreads: Array, positive: int | None
    ) -> list[Linear]:
        """Weigh the same columns under several priors, spreads of shape (m, p)."""
        grams = np.broadcast_to(gram(columns, target),
                                (len(spreads), self.channels, *2 * (columns.shape[-1] + 1,)))
        found = evidence(grams, self.count, spreads, self.observed.trusts)
        log = found.log
        if positive is not None:
            log = log + one_sided(found, positive)
        return [Linear(columns, target, spread, positive, float(log[i]),
                       Evidence(*(part[i:i + 1] for part in found)))
                for i, spread in enumerate(spreads)]

    def nothing(self) -> Linear:
        """The base model alone."""
        columns, spread = self.shared(self.base)
        return self.weigh(columns, self.target(self.base), spread[None, :], None)[0]

    # --- known effects ------------------------------------------------------------------------

    def signature(self, fit: Fit, effects: tuple[Effect, ...], added: Effect) -> Array | None:
        """Change of prediction / deviation by one typical size of an effect, (channels, n)."""
        model = Hypothesis(self.model, effects).model_at(fit.base, fit.sizes)
        here = predict(model, self.observed.points, self.channels)
        # The refit leaves little of an effect: the slope that counts is that of a small one.
        small = _SCREENED_SIZE * np.array([item.typical for item in added.sizes()])
        there = predict(Hypothesis(model, (added,)).model_at(fit.base, small),
                        self.observed.points, self.channels)
        change = (there - here) / self.observed.scale / _SCREENED_SIZE
        # Where the typical size cannot be carried it says nothing.
        return None if not np.isfinite(change).any() else np.nan_to_num(change)

    def screen(
        self, kinds: Sequence[type[Effect]], fit: Fit, effects: tuple[Effect, ...] = ()
    ) -> list[tuple[float, Effect, Linear]]:
        """Evidence of every form added to a refitted hypothesis, in linear approximation."""
        shared, spread = fit.jacobian, self.shared(fit)[1]
        own = np.concatenate([fit.base - BASE_MEAN, fit.nuisance,
                              fit.sizes / Hypothesis(self.model, effects).size_scales])
        target = fit.whitened + shared @ own
        spread = np.concatenate([spread, np.full(len(fit.sizes), 1.5)])
        results = []
        for kind in kinds:
            for form in forms_of(kind):
                change = self.signature(fit, effects, form)
                if change is None or np.abs(change).max() < _UNSEEN:
                    continue
                columns = np.concatenate([shared, change[..., None]], axis=-1)
                spreads = np.stack([np.append(spread, scale) for scale in SIZE_SPREADS])
                positive = columns.shape[-1] - 1 if form.sizes()[0].low >= 0.0 else None
                tried = self.weigh(columns, target, spreads, positive)
                best = max(tried, key=lambda item: item.log)
                results.append((log_mean(np.array([item.log for item in tried])), form, best))
        return sorted(results, key=lambda item: -item[0])

    def candidate(self, effects: tuple[Effect, ...]) -> Candidate:
        """Refit an hypothesis exactly and weigh it, with an allowance for its form."""
        hypothesis = Hypothesis(self.model, effects)
        fit = refit(hypothesis, self.observed, self.base.base, nuisance=self.nuisance)
        shared, spread = self.shared(fit)
        scaled = fit.sizes / hypothesis.size_scales
        own = fit.jacobian[..., _SHARED:]
        target = self.target(fit) + own @ scaled
        bends = [own[..., [i]] * scaled[i] * self.bends[:, 1:] for i in range(len(scaled))]
        columns = np.concatenate([shared, own, *bends], axis=-1)
        functions = self.bends.shape[1] - 1
        each = np.ones(functions * len(scaled)) / np.sqrt(functions / 3.0)
        spreads = np.stack([
            np.concatenate([spread, np.full(len(scaled), scale), allowance * each])
            for scale in SIZE_SPREADS for allowance in FORM_ALLOWANCES])
        last = effects[-1].sizes()[0]
        positive = _SHARED + len(scaled) - 1 if last.low >= 0.0 else None
        tried = self.weigh(columns, target, spreads, positive)
        best = max(tried, key=lambda item: item.log)
        p = _SHARED + len(scaled)
        plain = self.weigh(columns[..., :p], target, best.spread[None, :p], positive)[0]
        return Candidate(hypothesis.with_sizes(fit.sizes), fit, best, plain,
                         log_mean(np.array([item.log for item in tried])))

    @property
    def kinds(self) -> list[type[Effect]]:
        """Effects that these data could show."""
        present = {(type(effect).name, type(effect).form) for effect in self.model.effects}
        return [kind for kind in library() if (kind.name, kind.form) not in present]

    # --- what nobody listed ---------------------------------------------------------------------

    def fields(self, beside: Linear) -> list[Linear]:
        """A smooth loss over the working space, or a smooth slip, beside an hypothesis."""
        functions, degree = smooth_functions(self.observed.samples, _FIELD_DEGREE)
        decay = 2.0 ** -(degree - 1.0).clip(0.0) / 2.0
        models = []
        for channel, scales in enumerate((_FIELD_SPREADS, _SPEED_SPREADS)[: self.channels]):
            own = np.zeros((*beside.target.shape, functions.shape[1]))
            unit = self.observed.scale[channel]
            if channel == 1:
                unit = unit / self.observed.channels[1].measured
            own[channel] = functions / unit[:, None]
            columns = np.concatenate([beside.columns, own], axis=-1)
            spreads = np.stack([np.concatenate([beside.spread, scale * decay])
                                for scale in scales])
            models += self.weigh(columns, beside.target, spreads, beside.positive)
        return models

    def steps(self, boxes: Regions, beside: Linear, channel: int) -> tuple[Array, Array]:
        """A loss (or slip, in the output speed) inside each box beside an hypothesis.

        Returns:
            Log evidence of each, shape (boxes,), and the noise of the best, shape (channels,).
        """
        shared, target = beside.columns, beside.target
        unit = self.observed.scale[channel]
        if channel == 1:
            unit = unit / self.observed.channels[1].measured
        column = boxes.columns / unit
        p = shared.shape[-1]
        grams = np.zeros((len(boxes), self.channels, p + 2, p + 2))
        keep = np.append(np.arange(p), p + 1)
        grams[:, :, keep[:, None], keep] = gram(shared, target)
        grams[:, channel, p, p] = np.sum(column**2, axis=1)
        cross = column @ np.concatenate(
            [shared[channel], target[channel][:, None]], axis=1)
        grams[:, channel, p, keep] = cross
        grams[:, channel, keep, p] = cross
        found = [evidence(grams, self.count,
                          np.broadcast_to(np.append(beside.spread, scale), (len(boxes), p + 1)),
                          self.observed.trusts) for scale in _STEP_SPREADS]
        logs = np.logaddexp(found[0].log, found[1].log) - np.log(2.0)
        return np.asarray(logs), found[0].noise[logs.argmax()]

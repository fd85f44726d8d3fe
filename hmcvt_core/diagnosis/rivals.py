# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What may explain the readings: sets of known effects, losses that nobody listed, or nothing.

Each rival is refitted, or linear near a refit, and weighed by its evidence. No model is exact: with
effects come an allowance for forms that are a little off, and one for a base that is.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .evidence import Linear, evidence, gram, log_mean, respread, weigh
from .hypothesis import REFUSED, Fit, Hypothesis, Signature, linearise, refit
from .observations import SMOOTH_DEGREE, Observations, smooth_functions
from .regions import Regions
from .system import Array, Effect

SIZE_SPREADS = (0.5, 1.5, 5.0)
"""Prior standard deviations of a size, in typical sizes; equally likely."""

FORM_ALLOWANCES = (0.02, 0.07, 0.25)
"""How far a form may bend, smoothly over the working space, as a part of its own signature.

Equally likely; about what families of forms in the literature leave of each other, from power laws,
which agree once their exponents do, to films that break (docs/diagnosis.md).
"""

# Part of the squared change below which a loss beside a set is none, and from which it is one (the
# largest allowance for a form, once and nearly twice); up to which what a set misses by itself is
# what its forms do (that allowance along three axes makes 0.19), and from which it is nearly all of
# it; and how far the set is all of it then.
_LOST, _MISSED, _LISTED = (0.06, 0.2), (0.25, 0.75), (1.0, 0.01)
_EXACT = 1e-6  # in the place of a misfit: the base is exact
_ALLOWED_DEGREE = 2
_NOTHING_LEFT = 1e-9
_SCREENED_SPREAD = 1.5  # in typical sizes


@dataclass(frozen=True, eq=False)
class Rival:
    """One explanation.

    Attributes:
        fit: the refit near which it is linear.
        weighed: the linear model with its most likely allowances, at the widest prior of its sizes.
        plain: without allowances, at their most likely prior.
        log: log evidence over the prior scales.
        beside: a loss that nobody listed, or None.
    """

    fit: Fit
    weighed: Linear
    plain: Linear
    log: float
    beside: Loss | None = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Effect names, sorted."""
        return tuple(sorted(effect.name for effect in self.fit.hypothesis.effects))

    @cached_property
    def delivered(self) -> Fit:
        """The refit that is handed over."""
        return self.fit.delivered(self.weighed.noise)

    @property
    def by_itself(self) -> bool:
        """Whether it is known effects with the signs they have, and nothing beside them."""
        return (
            bool(self.names)
            and self.beside is None
            and not self.fit.hypothesis.opposite
        )

    def listed(self, bare: Rival) -> float:
        """How far known effects with the signs they have are all of it, 0 to 1.

        Less by a loss beside them that is more than their forms may miss, and by what the set
        misses by itself while its forms bend for it.
        """
        if not self.names or self.fit.hypothesis.opposite:
            return 0.0
        model, observed, own = self.weighed, self.fit.observed, len(self.fit.theta)
        known = own + len(observed.channels) * len(
            observed.smooth[1]
        )  # and a misfit of the base
        bent = (
            own + model.columns.shape[-1] - self.plain.columns.shape[-1]
        )  # all but a loss beside
        root = np.sqrt(model.noise)[:, None]
        start, left, unlost, unbent, alone = (
            rows / root
            for rows in (
                bare.fit.whitened,
                model.left(),
                model.left(bent),
                model.left(known),
                self.plain.left(own),
            )
        )
        every = np.sum((start - left) ** 2) + _NOTHING_LEFT
        gone = max(np.sum(start**2) - np.sum(left**2), _NOTHING_LEFT)
        lost = np.sum((unlost - left) ** 2) / every
        missed = min(
            np.sum((unbent - unlost) ** 2) / every,
            (np.sum(alone**2) - np.sum(left**2)) / gone,
        )
        return float(
            np.interp(lost, _LOST, _LISTED) * np.interp(missed, _MISSED, _LISTED)
        )

    @property
    def of_base(self) -> bool:
        """Whether it is a base model that is a little off and nothing else."""
        return not self.names and self.beside is not None and self.beside.of_base

    def at(self, points: Observations, allowing: bool = False) -> Foretold:
        """What it foretells of points, those of the campaign or others.

        Plainly, or with the allowances for forms and a base that are a little off.
        """
        model = self.weighed if allowing else self.plain
        there = (
            self.fit
            if points is self.fit.observed
            else linearise(self.fit.hypothesis, points, self.fit.theta, self.fit.noise)
        )
        columns, change = there.jacobian, np.zeros(len(model.mean))
        if allowing and self.names:
            columns = _allowance_columns(there, self.fit.observed)
        if self.beside is not None:
            columns = np.concatenate([columns, self.beside.columns(points)], axis=-1)
        if allowing or self.beside is not None:
            change = model.mean.copy()
            change[: len(self.fit.theta)] -= (
                self.fit.theta - self.fit.hypothesis.prior_mean
            )
        refused = (there.whitened == REFUSED).any(axis=0)
        return Foretold(
            np.where(refused, np.nan, columns @ change - there.whitened),
            columns,
            model.covariance,
        )


class Foretold(NamedTuple):
    """One explanation on possible tests, linear in its free parameters.

    Attributes:
        mean: reading above that of the point, in deviations, shape (channels, n); NaN: no answer.
        columns: shape (channels, n, p).
        covariance: of the free parameters, shape (p, p).
    """

    mean: Array
    columns: Array
    covariance: Array

    @property
    def spread(self) -> Array:
        """Covariance of what is foretold, without noise, shape (n, channels, channels)."""
        by_point = np.swapaxes(self.columns, 0, 1)
        return np.asarray(by_point @ self.covariance @ np.swapaxes(by_point, 1, 2))

    def measured(self, index: int) -> Foretold:
        """Return the same when a point has been read, whatever the reading (Kalman update)."""
        own = self.columns[:, index]
        gain = (
            self.covariance
            @ own.T
            @ np.linalg.inv(self.spread[index] + np.eye(len(own)))
        )
        return self._replace(covariance=self.covariance - gain @ own @ self.covariance)

    def against(self, other: Foretold, tests: float) -> float:
        """Squared deviations from another once this one has adapted, at the cost of its prior.

        Args:
            other: what the tests read.
            tests: how many, evenly over the points.
        """
        miss = (other.mean - self.mean).ravel()
        columns, each = self.columns.reshape(len(miss), -1), tests / self.mean.shape[1]
        # Without the inverse of a covariance over units of very different sizes.
        inner = np.eye(columns.shape[1]) + each * columns.T @ columns @ self.covariance
        cross = each * columns.T @ miss
        return float(
            each * miss @ miss - cross @ self.covariance @ np.linalg.solve(inner, cross)
        )


def nothing(base: Fit) -> Rival:
    """The refitted base model."""
    spread = base.hypothesis.system.base.spread
    (plain,) = weigh(
        base.observed, base.jacobian, base.target, spread[None], base.hypothesis.signs
    )
    return Rival(base, plain, plain, plain.log)


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

    def refit(self, opposite: bool = False) -> Fit:
        """Refit roughly from where the start ended."""
        hypothesis = replace(
            self.start.hypothesis, effects=self.effects, opposite=opposite
        )
        slopes = np.concatenate(
            [self.start.jacobian, np.stack(self.changes, axis=-1)], axis=-1
        )
        # Sizes of zero: the steps then never leave what the start had reached.
        start = np.append(self.start.theta, np.zeros(len(self.changes)))
        return refit(hypothesis, self.start.observed, start, slopes, rough=True)


def screen(
    fit: Fit, library: Sequence[Signature], count: int = 1, opposite: bool = False
) -> list[Proposal]:
    """Weigh some forms of different names added to a refit, in linear approximation, best first.

    Args:
        fit: what they are added to, without names that it has.
        library: the forms.
        count: how many at a time.
        opposite: with the wrong sign; effects that have either sign are left out.
    """
    hypothesis, names = (
        fit.hypothesis,
        {effect.name for effect in fit.hypothesis.effects},
    )
    kept = [
        (form, change)
        for form, change in library
        if form.name not in names and not (opposite and form.sizes()[0].low < 0.0)
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
    added = Hypothesis(hypothesis.system, forms, opposite)
    signs = np.append(hypothesis.signs, added.signs[hypothesis.shared :])[which]
    spread = hypothesis.spread(_SCREENED_SPREAD)
    (without,) = weigh(
        observed, fit.jacobian, fit.target, spread[None], hypothesis.signs
    )
    found = [
        evidence(
            grams,
            len(observed),
            np.append(spread, np.full(count, scale)),
            observed.trust,
            signs,
        )
        for scale in SIZE_SPREADS
    ]
    log = log_mean([each.log for each in found]) - without.log
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


def explanation(fit: Fit) -> Rival:
    """Weigh a refit with its allowances."""
    observed, hypothesis = fit.observed, fit.hypothesis
    sizes, k = hypothesis.sizes, len(fit.sizes)
    off, columns = base_misfit(observed)[1], _allowance_columns(fit, observed)
    bends = columns.shape[-1] - len(fit.theta) - len(off)  # of k forms together
    each = np.full(bends, np.sqrt(len(observed.place) * k / max(bends, 1)))
    widest = np.full(k, max(SIZE_SPREADS))
    spreads = np.stack(
        [
            np.concatenate([hypothesis.spread(widest), misfitting, allowance * each])
            for allowance in FORM_ALLOWANCES
            for misfitting in (off, np.full(len(off), _EXACT))
        ]
    )
    tried = weigh(
        observed, columns, fit.target, spreads, np.full(len(spreads[0]), np.nan)
    )
    scales = np.array(list(itertools.product(SIZE_SPREADS, repeat=k)))
    signs = hypothesis.signs
    logs = np.array(
        [
            item.log
            + respread(
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
    (plain,) = weigh(
        observed,
        fit.jacobian,
        fit.target,
        hypothesis.spread(scales[scale])[None],
        signs,
    )
    return Rival(fit, tried[best], plain, float(log_mean(logs.ravel())))


def _allowance_columns(fit: Fit, campaign: Observations) -> Array:
    """Columns of a refit, of a misfit of the base and of the bends of each form.

    Smooth over the working space of a campaign; shape (channels, n, p).
    """
    misfit, _ = base_misfit(campaign)
    degree = campaign.smooth[1]
    bends = misfit.functions(fit.observed)[
        :, (degree > 0) & (degree <= _ALLOWED_DEGREE)
    ]
    return np.concatenate(
        [
            fit.jacobian,
            misfit.columns(fit.observed),
            *(
                fit.jacobian[..., [i]] * fit.theta[i] * bends
                for i in fit.hypothesis.sizes
            ),
        ],
        axis=-1,
    )


def exact(fit: Fit) -> Rival:
    """Weigh a refit with slopes taken there, not mended on the way."""
    return explanation(refit(fit.hypothesis, fit.observed, fit.theta))


@dataclass(frozen=True, eq=False)
class Loss:
    """A loss that nobody listed, in some channels: smooth over a working space, or inside a box.

    Attributes:
        campaign: whose working space it is.
        channels: their indices.
        box: limits of the place, shape (2, axes); None for a smooth one.
        of_base: whether it is what a base model that is a little off leaves.
    """

    campaign: Observations
    channels: tuple[int, ...]
    box: Array | None = None
    of_base: bool = False

    def columns(self, points: Observations) -> Array:
        """Change of the readings / deviation by each coefficient, shape (channels, n, m).

        Those of one channel after another.
        """
        return np.einsum(
            "kcn,nm->cnkm",
            points.unit_loss[list(self.channels)],
            self.functions(points),
        ).reshape(*points.measured.shape, -1)

    def functions(self, points: Observations) -> Array:
        """What it may be made of, shape (n, m)."""
        if self.box is not None:
            low, high = self.box[..., None]
            inside = (points.place >= low) & (points.place <= high)
            return inside.all(axis=0)[:, None].astype(float)
        return (
            self.campaign.smooth[0]
            if points is self.campaign
            else smooth_functions(points.place, SMOOTH_DEGREE, self.campaign.place)[0]
        )

    def spread(self, *scales: float) -> Array:
        """Prior standard deviations of a smooth one, by channel: the rougher, the smaller."""
        rough = 2.0 ** -(self.campaign.smooth[1] - 1.0).clip(0.0) / 2.0
        return np.asarray(np.outer(scales, rough).ravel())


def _with_loss(rival: Rival, loss: Loss, spreads: Iterable[Array]) -> Rival:
    """Weigh a rival with a loss beside it, under several priors."""
    observed, found = rival.fit.observed, []
    for model in (rival.weighed, rival.plain):
        columns = np.concatenate([model.columns, loss.columns(observed)], axis=-1)
        found.append(
            weigh(
                observed,
                columns,
                model.target,
                np.stack([np.append(model.spread, spread) for spread in spreads]),
                np.append(
                    model.signs, np.full(columns.shape[-1] - len(model.signs), np.nan)
                ),
            )
        )
    best = int(np.argmax([item.log for item in found[0]]))
    return Rival(
        rival.fit,
        found[0][best],
        found[1][best],
        float(log_mean([item.log for item in found[0]])),
        loss,
    )


def base_misfit(observed: Observations) -> tuple[Loss, Array]:
    """A base model that is a little off in every channel, and its prior deviations."""
    loss = Loss(observed, tuple(range(len(observed.channels))), of_base=True)
    return loss, loss.spread(*(channel.misfit_spread for channel in observed.channels))


def misfitting(bare: Rival) -> Rival:
    """Weigh a base model that is a little off and nothing else."""
    loss, spread = base_misfit(bare.fit.observed)
    return _with_loss(bare, loss, [spread])


def fields(rival: Rival) -> list[Rival]:
    """Weigh a smooth loss that nobody listed beside a rival, channel by channel."""
    observed = rival.fit.observed
    losses = [
        (Loss(observed, (i,)), channel) for i, channel in enumerate(observed.channels)
    ]
    return [
        _with_loss(rival, loss, [loss.spread(scale) for scale in channel.field_spreads])
        for loss, channel in losses
    ]


def local(rival: Rival, boxes: Regions) -> list[Rival]:
    """Weigh a loss inside any box beside a rival; `log` is over all boxes, the rest of the best.

    The boxes are compared at the noise that the rival leaves, the best is weighed in full.
    """
    observed, model = rival.fit.observed, rival.weighed
    if not len(boxes):
        return []
    noise, gains = model.noise[:, None], []
    left = model.left()
    for unit, channel in zip(observed.unit_loss, observed.channels, strict=True):
        # Over all channels at once: a box holds or does not hold a sample.
        shadow, whole, pull = (
            boxes.members @ np.einsum("cn,cn...->n...", unit / noise, each)
            for each in (model.columns, unit, left)
        )
        squares = np.maximum(  # of what the rival leaves; all but none at least
            whole - np.sum(shadow @ model.covariance * shadow, axis=1),
            _NOTHING_LEFT * whole,
        )
        ratios = np.square(channel.step_spreads)[:, None] * squares
        gains.append(
            log_mean(
                0.5 * (pull**2 / squares * ratios / (1.0 + ratios) - np.log1p(ratios))
            )
        )
    best, box = divmod(int(np.argmax(gains)), len(boxes))
    # An edge of the campaign is none of the place.
    ends = observed.place.min(axis=1), observed.place.max(axis=1)
    low = np.where(boxes.low[box] <= ends[0], -np.inf, boxes.low[box])
    high = np.where(boxes.high[box] >= ends[1], np.inf, boxes.high[box])
    found = _with_loss(
        rival,
        Loss(observed, (best,), np.stack([low, high])),
        [np.array([scale]) for scale in observed.channels[best].step_spreads],
    )
    return [
        replace(found, log=found.log + float(log_mean(np.ravel(gains)) - np.max(gains)))
    ]

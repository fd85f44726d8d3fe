# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between model and bench: where, which effect, how far it shrinks."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from ..errors import InputError
from .design.next_test import Advice, advise
from .detection.regions import Regions, candidate_regions, covering
from .detection.significance import Significance, significance
from .fitting.cross_validation import cross_validated_errors, fold_assignments
from .fitting.refit import Fit, refit
from .observations import Observations
from .preparation import describe_samples, prepare
from .results import outcome as result
from .results.outcome import NAMING, Cause, CauseSet
from .results.text import Diagnosis
from .selection.explanation import Explanation
from .selection.posterior import Posterior, compute_posterior
from .settings import (
    CAUSE_FOUND_PROBABILITY,
    GAP_SIGNIFICANCE,
    MOST_REGIONS,
    NO_ANSWER,
    RIVAL_SET_MARGIN,
    ROUNDING,
    SHRINKAGE_DRAWS,
    SHRINKAGE_TAIL,
    SMALL_CAMPAIGN,
    SUMMARISED_SETS,
    UNEXPLAINED_PROBABILITY,
)
from .system import Array, Effect, Points, System


@dataclass(frozen=True, eq=False)
class _Study:
    """A campaign once everything has been weighed; `seed` is that of every random number."""

    ranking: Posterior
    boxes: Regions
    found: Significance
    seed: int

    @property
    def base(self) -> Fit:
        """The refit without any effect."""
        return self.ranking.base_only.fit

    @property
    def significant(self) -> bool:
        """Whether there is a gap."""
        return self.found.p_value <= GAP_SIGNIFICANCE

    @cached_property
    def leading(self) -> tuple[Explanation, float]:
        """The most probable set of listed effects."""
        return next(iter(self.ranking.sets.values()))

    @cached_property
    def before(self) -> Array:
        """Errors of the base model at samples left out, shape (n,)."""
        return self.errors(self.ranking.base_only)

    @cached_property
    def errors(self) -> Callable[[Explanation], Array]:
        """Errors of a rival at samples left out, shape (n,); worked out once for each."""
        observed, dealt = (
            self.base.observed,
            fold_assignments(self.base.observed, self.seed),
        )
        # A size is held at its bound in what is handed over, not in the folds.
        return cache(
            lambda rival: max(
                cross_validated_errors(rival.plain_model, observed, dealt),
                rival.served_fit.whitened[0] * observed.deviation[0],
                key=_rms,
            )
        )

    @cached_property
    def shrunk(self) -> Callable[[Explanation], result.ShrinkageSummary]:
        """How far the gap shrinks with a set held in every fold; worked out once for each."""
        return cache(
            lambda rival: shrinkage(
                self.before,
                self.errors(rival),
                self.noise,
                "cross-validation",
                self.seed,
                least=self._foretold(rival),
            )
        )

    @cached_property
    def expected(self) -> tuple[Array, Array]:
        """The gap at the samples and its standard deviation, over all that is alive."""
        return self.ranking.relevant.gap_at()

    def _foretold(self, rival: Explanation) -> Array:
        """Mean squares expected of the gap before and after a set, shape (2,)."""
        (mean, deviation), unit = self.expected, self.base.observed.deviation[0]
        before, after = (
            np.where(fit.whitened[0] == NO_ANSWER, np.nan, fit.whitened[0] * unit)
            for fit in (self.base, rival.served_fit)
        )
        return np.nanmean(
            [mean**2, (mean - before + after) ** 2] + deviation**2, axis=1
        )

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of the first channel, (n,); without a gap that of the base model."""
        ranking = self.ranking
        likeliest = (
            ranking.entries[0][0].model
            if self.significant
            else ranking.base_only.plain_model
        )
        return np.asarray(self.base.observed.deviation[0] * np.sqrt(likeliest.noise[0]))


def diagnose_system(
    system: System,
    observed: Observations,
    held: Observations | None = None,
    *,
    warnings: Sequence[str] = (),
    notes: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between the model of a system and a bench.

    The base parameters are refitted first: a gap that a refit closes is no gap.

    Args:
        system: what stands on the bench.
        observed: at least five samples.
        held: samples to measure the shrinkage on; None for cross-validation.
        warnings: why the readings may be of another machine; they go before everything.
        notes: on the samples, to go first.
        seed: of every random number.
        progress: called with a line of text before each step; may raise to cancel.

    Raises:
        InputError: samples cannot carry a diagnosis.
    """
    tell = progress or (lambda text: None)
    base, more = prepare(system, observed)
    observed = base.observed
    boxes = candidate_regions(observed.coordinates)
    tell("step 1 of 3, is there a gap")
    found = significance(base, boxes, seed)
    tell("step 2 of 3, refits with sets of effects")
    study = _Study(compute_posterior(base, boxes, seed), boxes, found, seed)
    tell("step 3 of 3, how far the gap shrinks")
    ranking, residuals, real = study.ranking, study.before, study.significant
    verdict, why = _verdict(study)
    after = study.errors(study.leading[0]) if real else residuals
    delivered = result.Delivered(
        _rms(residuals), _rms(after if verdict in NAMING else residuals)
    )
    before, noise, judged, held_out = residuals, study.noise, observed, list[str]()
    if held is not None:
        before, after, noise, judged, held_out = _errors_on(study, held)
    shrunk = (
        study.shrunk(study.leading[0])
        if real and held is None
        else shrinkage(
            before,
            after,
            noise,
            "cross-validation" if held is None else "holdout",
            seed,
            real,
        )
    )
    gap = result.Gap(
        len(residuals),
        _rms(residuals),
        _rms(study.noise),
        observed.stated_noise,
        observed.noise_source,
        found.p_value,
        real,
    )
    advice = advise(ranking, system.candidates(observed.points, base.base))
    expected = study.expected[0]
    return Diagnosis(
        gap,
        _where(study, expected),
        verdict,
        _causes(study, verdict),
        _sets(study) if real else (),
        shrunk,
        delivered,
        advice.next_tests,
        advice,
        ranking.unlisted if real else 0.0,
        ranking.misfit if real else 0.0,
        _lost_power(study, verdict, expected),
        tuple(warnings),
        (
            *warnings,
            *notes,
            *more,
            *held_out,
            *_on_noise(study),
            *system.remarks(observed.samples),
            *why,
        ),
        _model_of(base),
        ranking.relevant,
        observed.samples,
        residuals,
        judged.samples,
        before,
        after,
    )


def next_test(
    system: System,
    observed: Observations,
    possible: Points | None = None,
    *,
    notes: Sequence[str] = (),
    seed: int = 0,
) -> Advice:
    """Choose the next test of a campaign; arguments and errors as of `diagnose_system`.

    Args:
        system, observed, notes, seed: as there.
        possible: the tests that can be run; None for those that the system knows.
    """
    base, more = prepare(system, observed)
    if possible is None:
        possible = system.candidates(base.observed.points, base.base)
    found = advise(
        compute_posterior(base, candidate_regions(base.observed.coordinates), seed),
        possible,
    )
    return replace(found, notes=(*notes, *more))


def shrinkage(
    before: Array,
    after: Array,
    noise: Array,
    on: str,
    seed: int,
    real: bool = True,
    least: Array | float = 0.0,
) -> result.ShrinkageSummary:
    r"""Say how far the gap shrinks, from errors on data not used for the fit.

    .. math:: G^2 = \overline{e^2} - \sigma^2, \qquad S = 1 - G^2_{after} / G^2_{before}

    e are errors of prediction at the same points, sigma is the noise.

    Args:
        before, after: errors of the first channel, shape (n,).
        noise: standard deviation of the first channel at each, shape (n,) or scalar.
        on: where the errors come from.
        seed: of the bootstrap over points.
        real: whether there is a gap at all; without one `fraction` is None.
        least: G^2 before and after, shape (2,), as far as the noise hides them; by default a gap
            below the noise is none.
    """
    squares = (
        np.stack([before**2, after**2], axis=1)
        - np.broadcast_to(np.square(noise), before.shape)[:, None]
    )
    mean, hidden = np.maximum(squares.mean(axis=0), 0.0), np.mean(np.square(noise))
    mean = np.maximum(mean, least * hidden / max(hidden + mean[0], ROUNDING**2))
    fraction, interval = None, None
    if real and mean[0] > 0.0:
        rng, n = np.random.default_rng(seed), len(squares)
        drawn = np.stack(
            [
                mean,
                *(
                    squares[rng.integers(0, n, n)].mean(axis=0)
                    for _ in range(SHRINKAGE_DRAWS)
                ),
            ]
        )
        drawn = drawn[drawn[:, 0] > 0.0]
        # Below the noise nothing is left to remove; a gap cannot shrink by more than all of it.
        fraction, *others = np.clip(
            1.0 - drawn[:, 1] / drawn[:, 0], -10.0, 1.0
        ).tolist()
        if others:
            low, high = np.quantile(
                others, [SHRINKAGE_TAIL, 1.0 - SHRINKAGE_TAIL]
            ).tolist()
            interval = min(low, fraction), max(high, fraction)
    gap = np.sqrt(mean).tolist()
    return result.ShrinkageSummary(gap[0], gap[1], fraction, interval, on)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _model_of(fit: Fit) -> Any:
    return fit.hypothesis.system.model_of(fit.base, fit.effects, fit.observed.samples)


def _verdict(study: _Study) -> tuple[str, list[str]]:
    """Return the verdict, and why no cause is named."""
    ranking, (leading, probability) = study.ranking, study.leading
    if not study.significant:
        return "no_gap", []
    if ranking.unlisted > UNEXPLAINED_PROBABILITY:
        return "unexplained", [
            "the base model is a little off, smoothly: less than what a cause would need"
            if ranking.misfit > ranking.unlisted / 2.0
            else "no set of listed effects explains the gap: look at the regions"
        ]
    # A prior, or a form more, does not tell two sets apart.
    twins = [
        rival
        for names, (rival, _) in ranking.sets.items()
        if len(names) == len(leading.names)
        and rival is not leading
        and rival.log_evidence > leading.log_evidence - RIVAL_SET_MARGIN
    ]
    first = ranking.entries[0][0]
    rest = (
        ["a smaller loss that nobody listed stands beside it: look at the regions"]
        if first.discrepancy is not None
        and first.explained_fraction(ranking.base_only) > 0.5
        else []
    )
    return (
        "cause_found"
        if probability >= CAUSE_FOUND_PROBABILITY and not twins
        else "ambiguous",
        rest,
    )


def _lost_power(study: _Study, verdict: str, gap: Array) -> float:
    """Mean over the samples, of the leading set [W]; where none is named, over where the gap is."""
    fit = study.leading[0].served_fit if verdict in NAMING else study.base
    system, points = fit.hypothesis.system, study.base.observed.points
    (expected,) = system.predict(fit.base, (), points)[:1]
    if fit is not study.base:
        real = fit.hypothesis.predict(fit.theta, points)[0]
        return float(np.mean(system.lost_power(points, expected, real)))
    lost = system.lost_power(points, expected, expected + gap)
    known = np.isfinite(gap)  # where the base gives an answer
    return float(np.mean(lost[known & (np.abs(gap) >= _rms(gap[known]))]))


def _sets(study: _Study) -> tuple[CauseSet, ...]:
    told = list[CauseSet]()
    for names, (rival, p) in study.ranking.sets.items():
        each = study.shrunk(rival) if len(told) < SUMMARISED_SETS else None
        told.append(
            CauseSet(names, p, *((each.after, each.fraction) if each else (None, None)))
        )
    return tuple(told)


def _errors_on(
    study: _Study, held: Observations
) -> tuple[Array, Array, Array, Observations, list[str]]:
    """Errors before and after on samples held out, their noise, those with an answer, and notes.

    After: of the model of the leading set, the one that is saved. Samples that do not state
    their noise have that of the campaign.
    """
    base, refusal = study.base, study.base.hypothesis.system.refusal
    first = study.leading[0].served_fit
    before, after = (
        held.measured[0] - fit.hypothesis.predict(fit.theta, held.points)[0]
        for fit in (base, first if study.significant else base)
    )
    usable = np.isfinite(before) & np.isfinite(after)
    if not usable.any():
        raise InputError(
            f"{held.samples.source}: the model has no answer at any of the operating "
            "points held out"
        )
    stalled = np.flatnonzero(~usable)
    notes = (
        [
            f"{len(stalled)} of {len(held)} samples held out {refusal} and do not count: "
            f"{describe_samples(held, stalled)}"
        ]
        if len(stalled)
        else []
    )
    held = held.select(np.flatnonzero(usable))
    noise = np.full(len(held), _rms(study.noise)) if held.assumed else held.deviation[0]
    return before[usable], after[usable], noise, held, notes


def _causes(study: _Study, verdict: str) -> tuple[Cause, ...]:
    if not study.significant:
        return ()
    # The members of the leading set first, so that the first cause is one of it.
    leading = study.leading[0].names
    probability = dict(
        sorted(
            study.ranking.effects.items(),
            key=lambda item: (item[0] not in leading, -item[1]),
        )
    )
    names = [name for name, p in probability.items() if p >= 0.01 or name in leading]
    return tuple(
        _cause(study, name) for name in names[: 3 if verdict == "unexplained" else 6]
    )


def _cause(study: _Study, name: str) -> Cause:
    rival = study.ranking.best_with(name)
    fit = rival.served_fit
    effects = fit.effects
    index = [effect.name for effect in effects].index(name)
    effect, hypothesis = effects[index], fit.hypothesis
    # At the fitted shapes: with them free, a size may be anything that keeps the loss.
    kept = [*range(hypothesis.base_count), *hypothesis.size_indices]
    known = np.linalg.inv(rival.plain_model.covariance)[np.ix_(kept, kept)]
    errors = np.sqrt(np.diagonal(np.linalg.inv(known)))
    shrunk = study.shrunk(rival)
    partners = [other for other in rival.names if other != name]
    return Cause(
        name,
        effect.form,
        effect.component,
        study.ranking.effects[name],
        _twins(study.ranking, name),
        " and ".join(partners) or None,
        _parameters(effect, errors[hypothesis.base_count + index]),
        shrunk.after,
        shrunk.fraction,
        _drift(study.base, fit, errors),
        effect.summary,
        effect.source,
        effect.remedy,
        _model_of(fit),
    )


def _twins(ranking: Posterior, name: str) -> tuple[str, ...]:
    """Effects that these data cannot tell from one: the rest of the credible set.

    It holds at each step the effect that most of the probability still missed needs; sets of none
    but the partners of the one are no alternatives.
    """
    partners, chosen = set(ranking.best_with(name).names) - {name}, list[str]()
    missed = {
        names: p
        for names, (_, p) in ranking.sets.items()
        if not partners.issuperset(names)
    }
    least = (1.0 - CAUSE_FOUND_PROBABILITY) * sum(missed.values()) + ROUNDING
    while sum(missed.values()) > least:
        need = {
            other: sum(p for names, p in missed.items() if other in names)
            for other in dict.fromkeys(itertools.chain(*missed))
            if other not in partners
        }
        chosen.append(max(need, key=need.__getitem__))
        missed = {names: p for names, p in missed.items() if chosen[-1] not in names}
    return tuple(other for other in chosen if other != name)


def _parameters(effect: Effect, error: float) -> dict[str, dict[str, Any]]:
    """`Cause.parameters`; standard error of the size in typical ones."""
    values: dict[str, dict[str, Any]] = {}
    for parameter in effect.parameters():
        value = effect.values()[parameter.name]
        entry = values[parameter.name] = {
            "value": value,
            "unit": parameter.unit,
            "meaning": parameter.meaning,
        }
        if parameter.is_size:
            spread = 1.96 * float(error) * parameter.typical
            entry["interval"] = [
                max(value - spread, parameter.low),
                min(value + spread, parameter.high),
            ]
            entry["plausible"] = bool(
                parameter.low < value < parameter.high
                and abs(value) <= 5.0 * abs(parameter.typical)
            )
    return values


def _drift(before: Fit, after: Fit, errors: Array) -> dict[str, dict[str, float]]:
    base = before.hypothesis.system.base
    rows = np.stack(
        [
            base.values(before.base),
            base.values(after.base),
            (before.base - after.base) / errors[: len(base)],
        ],
        axis=1,
    )
    keys = ("without_effect", "with_effect", "standard_errors")
    return {
        name: dict(zip(keys, row, strict=True))
        for name, row in zip(base.names, rows.tolist(), strict=True)
    }


def _where(study: _Study, expected: Array) -> tuple[result.Region, ...]:
    """The fewest regions that hold the points at which the gap expected exceeds its rms."""
    boxes, found = study.boxes, study.found
    if not study.significant or not len(boxes):
        return ()
    chosen = covering(boxes.members, np.abs(expected) > _rms(expected), MOST_REGIONS)
    chosen.sort(key=lambda i: -abs(np.sum(expected[boxes.members[i]])))
    observed = study.base.observed
    residual = study.base.whitened[0] * observed.deviation[0]
    limits = np.stack([boxes.low, boxes.high], axis=-1).tolist()
    return tuple(
        result.Region(
            {
                axis.name: (low, high)
                for axis, (low, high) in zip(observed.steered, limits[i], strict=True)
            },
            float(residual[boxes.members[i]].mean()),
            int(boxes.members[i].sum()),
            float(found.region_p[i]),
            observed.channels[found.region_channel[i]].name,
        )
        for i in chosen
    )


def _on_noise(study: _Study) -> list[str]:
    """Say that the noise found is not the one stated, or what a statement would change."""
    observed = study.base.observed
    channel, stated, found = (
        observed.channels[0],
        observed.stated_noise,
        _rms(study.noise),
    )
    ratio = found / stated
    if observed.assumed and len(observed) < SMALL_CAMPAIGN:
        noise = float(f"{stated:.2g}")
        believed = refit(study.base.hypothesis, observed.with_stated_noise(noise))
        p_value = significance(believed, study.boxes, study.seed).p_value
        return [
            f"nobody stated the noise, and {len(observed)} samples cannot tell it from a gap: "
            f"the verdict rests on an assumption; if the noise is known to be "
            f"{channel.factor * noise:.2g} {channel.unit}, --noise {noise:g} gives p = "
            f"{p_value:.2g}"
        ]
    if 0.75 < ratio < 1.33:
        return []
    if not observed.assumed:
        return [
            f"the noise looks {ratio:.2f} times the one stated ({observed.noise_source}): "
            "check the statement"
        ]
    if np.ptp(observed.deviation[0] / channel.deviation(observed.measured[0])) > 1e-9:
        return []  # uneven: no one number states it
    return [
        f"nobody stated the noise; it looks like {channel.factor * found:.2g} {channel.unit}, "
        f"{ratio:.2f} times what is assumed: --noise {found:.2g} states that"
    ]

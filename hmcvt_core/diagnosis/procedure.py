# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between model and bench: where, which effect, how far it shrinks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .hypothesis import Fit, refit
from .intake import admitted, listed_samples
from .observations import FEW, Observations
from .plans import next_tests
from .ranking import Linear, Ranking, pair_candidates, rank, single_candidates
from .regions import Regions, regions
from .report import Diagnosis
from .result import GAP_SIGNIFICANCE, REGION_SIGNIFICANCE, Cause, Gap, Region, ShrinkageSummary
from .shrinkage import cross_validated_errors, deals, shrinkage
from .significance import Significance, significance
from .system import Effect, System
from .words import plain

Array = NDArray[np.float64]

FOUND = 0.80  # probability from which one cause is called found
SET_PROBABILITY = 0.97  # with which the set that cannot be told apart holds a listed cause
ADEQUATE = 0.5  # part of the gap that a named cause must remove; else the gap is unexplained
# The same for the squared gap of a further channel: read only where it is much more exact.
ADEQUATE_BESIDE = 0.8
UNLISTED = 0.2  # probability of an unlisted effect from which a poor cause is not named
LEFTOVER = 5.0  # log evidence from which something is left beside the leading cause
_LARGE_REGION = 0.8  # discount of a region with most of the samples
_MOST_REGIONS = 5
_OVERLAP = 0.2
_RIVALS = 12
_ZERO = 1e-9


@dataclass(frozen=True, eq=False)
class _Study:
    """What is known of a campaign once everything has been weighed.

    Attributes:
        base, boxes, found, ranking: the results of the steps.
        seed: of every random number.
        dealt: folds, several times.
    """

    base: Fit
    boxes: Regions
    found: Significance
    ranking: Ranking
    seed: int
    dealt: list[list[NDArray[np.intp]]]

    @property
    def significant(self) -> bool:
        """Whether there is a gap."""
        return self.found.p_value <= GAP_SIGNIFICANCE

    @cached_property
    def before(self) -> Array:
        """Errors of the base model at samples left out, shape (n,)."""
        return self.errors([self.ranking.nothing])

    def errors(self, rivals: Sequence[Linear]) -> Array:
        """Errors of the best of some rivals at samples left out, shape (n,)."""
        return cross_validated_errors(rivals, self.base.observed, self.dealt)

    @property
    def noise(self) -> Array:
        """Standard deviation of the first channel, (n,); without a gap that of the base model."""
        variance = self.ranking.noise if self.significant else self.ranking.nothing.noise[0]
        return np.asarray(self.base.observed.scale[0] * np.sqrt(variance))

    @property
    def scatter(self) -> float:
        """Root of the mean square of the noise of single samples."""
        count = self.base.observed.count
        return float(np.sqrt(np.average(self.noise**2 * count, weights=count)))


def diagnose_system(
    system: System,
    observed: Observations,
    held: Observations | None = None,
    *,
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
        notes: on the samples, to go first.
        seed: of every random number.
        progress: called with a line of text before each step; may raise to cancel.

    Raises:
        InputError: samples cannot carry a diagnosis.
    """
    tell = progress or (lambda text: None)
    base, more = admitted(system, observed)
    observed = base.observed
    boxes = regions(observed.place)
    tell("step 1 of 4, is there a gap")
    found = significance(base, boxes, seed)
    tell("step 2 of 4, refits with each effect")
    singles = single_candidates(base)
    ranking = rank(base, boxes, singles)
    if found.p_value <= GAP_SIGNIFICANCE and (
            ranking.unlisted > 0.01 or ranking.leftover > LEFTOVER):
        tell("step 3 of 4, refits with pairs of effects")
        ranking = rank(base, boxes, [*singles, *pair_candidates(base, singles)])
    tell("step 4 of 4, how far the gap shrinks")
    study = _Study(base, boxes, found, ranking, seed, deals(observed, seed))
    before, after, noise, count = study.before, study.before, study.noise, observed.count
    held_out: list[str] = []
    judged = observed.whole
    if held is not None:
        before, after, noise, judged, held_out = _errors_on(study, held)
    elif study.significant:
        after = study.errors([ranking.nothing,
                              *(item.plain for item in ranking.candidates[:_RIVALS])])
    shrunk = shrinkage(before, after, noise, "cross-validation" if held is None else "holdout",
                       seed, study.significant, count if held is None else 1.0)
    residuals = observed.at_samples(study.before)
    if held is None:
        before, after = observed.at_samples(before), observed.at_samples(after)
    verdict, why = _verdict(study, shrunk)
    causes = _causes(study, verdict) if study.significant else ()
    gap = Gap(len(residuals), _rms(residuals), study.scatter, observed.whole.usual_noise,
              observed.noise_source, found.p_value, study.significant)
    extent = {axis.name: (float(row.min()), float(row.max()))
              for axis, row in zip(observed.steered, observed.whole.place, strict=True)}
    return Diagnosis(
        gap, _where(study), verdict, causes, shrunk,
        next_tests(base, ranking) if study.significant else (),
        ranking.unlisted if study.significant else 0.0,
        (*notes, *more, *held_out, *_on_noise(study), *system.remarks(observed.samples),
         *_at_zero(base), *why),
        _model_of(base), observed.samples, residuals, judged.samples, before, after,
        observed.steered, extent, observed.readings[0].channel)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _model_of(fit: Fit) -> Any:
    return fit.hypothesis.system.model_of(fit.base, fit.effects, fit.observed.samples)


def _verdict(study: _Study, shrunk: ShrinkageSummary) -> tuple[str, list[str]]:
    """Return the verdict, and why no cause is named."""
    if not study.significant:
        return "no_gap", []
    ranking = study.ranking
    known = next(iter(ranking.probability.values()))
    removed = shrunk.fraction if shrunk.fraction is not None else 0.0
    # NaN, and so False in either comparison, where a channel shows no clear gap.
    beside = ranking.explained[1:]
    wanting = ranking.unlisted > UNLISTED or ranking.leftover > LEFTOVER
    if ranking.unlisted > 0.5 or (removed < ADEQUATE and wanting):
        return "unexplained", ["no listed effect removes most of the gap: look at the regions"]
    if (beside < ADEQUATE_BESIDE).any():
        worst = int(np.nanargmin(beside))
        channel = study.base.observed.readings[1 + worst].channel
        return "unexplained", [
            f"the best of the listed effects explains {max(0.0, 100.0 * beside[worst]):.0f} % of "
            f"what the {plain(channel.name)} shows: look at the regions"]
    adequate = removed >= ADEQUATE or (beside >= ADEQUATE_BESIDE).any()
    return "cause_found" if known >= FOUND and adequate else "ambiguous", []


def _errors_on(
    study: _Study, held: Observations
) -> tuple[Array, Array, Array, Observations, list[str]]:
    """Errors before and after on samples held out, their noise, those with an answer, and notes.

    After: of the model of the first cause, the one that is saved. Samples that do not state
    their noise have that of the campaign.
    """
    base, refusal = study.base, study.base.hypothesis.system.refusal
    first = study.ranking.best[next(iter(study.ranking.probability))].fit
    before, after = (held.readings[0].measured - fit.hypothesis.predict(fit.theta, held.points)[0]
                     for fit in (base, first if study.significant else base))
    usable = np.isfinite(before) & np.isfinite(after)
    if not usable.any():
        raise InputError(f"{held.samples.source}: the model has no answer at any of the operating "
                         "points held out")
    stalled = np.flatnonzero(~usable)
    notes = [f"{len(stalled)} of {len(held)} samples held out {refusal} and do not count: "
             f"{listed_samples(held, stalled)}"] if len(stalled) else []
    held = held.select(np.flatnonzero(usable))
    noise = (np.full(len(held), study.scatter) if held.assumed
             else held.readings[0].deviation)
    return before[usable], after[usable], noise, held, notes


def _causes(study: _Study, verdict: str) -> tuple[Cause, ...]:
    probability = study.ranking.probability
    names = [name for name, p in probability.items() if p >= 0.01] or list(probability)[:1]
    return tuple(_cause(study, name) for name in names[:3 if verdict == "unexplained" else 6])


def _cause(study: _Study, name: str) -> Cause:
    item = study.ranking.best[name]
    index = item.names.index(name)
    effect, errors = item.fit.effects[index], np.sqrt(np.diagonal(item.plain.covariance))
    shrunk = shrinkage(study.before, study.errors([item.plain]), study.noise, "cross-validation",
                       study.seed, weight=study.base.observed.count)
    partner = next((other for other in item.names if other != name), None)
    first = item.fit.hypothesis.shared + sum(
        len(other.sizes()) for other in item.fit.effects[:index])
    return Cause(
        name, effect.form, effect.component, study.ranking.probability[name],
        _twins(study.ranking, name), partner, _parameters(effect, errors[first:]), shrunk.after,
        shrunk.fraction, _drift(study.base, item.fit, errors), effect.summary, effect.source,
        effect.remedy, _model_of(item.fit))


def _twins(ranking: Ranking, name: str) -> tuple[str, ...]:
    """Effects that these data cannot tell from one: the rest of the credible set."""
    partners = set(ranking.best[name].names) - {name}
    total, chosen = 0.0, []
    for other, p in ranking.probability.items():
        if total < SET_PROBABILITY * (1.0 - ranking.unlisted) and other not in partners:
            total += p
            chosen.append(other)
    return tuple(other for other in chosen if other != name) if name in chosen else ()


def _parameters(effect: Effect, errors: Array) -> dict[str, dict[str, Any]]:
    """`Cause.parameters`; standard errors of the sizes in typical ones, in order."""
    values: dict[str, dict[str, Any]] = {}
    spreads = iter((1.96 * errors).tolist())
    for parameter in effect.parameters():
        value = effect.values()[parameter.name]
        entry = values[parameter.name] = {"value": value, "unit": parameter.unit,
                                          "meaning": parameter.meaning}
        if parameter.is_size:
            spread = next(spreads) * parameter.typical
            entry["interval"] = [max(value - spread, parameter.low),
                                 min(value + spread, parameter.high)]
            entry["plausible"] = bool(parameter.low < value < parameter.high
                                      and abs(value) <= 5.0 * abs(parameter.typical))
    return values


def _drift(before: Fit, after: Fit, errors: Array) -> dict[str, dict[str, float]]:
    base = before.hypothesis.system.base
    rows = np.stack([base.values(before.base), base.values(after.base),
                     (before.base - after.base) / errors[:len(base)]], axis=1)
    keys = ("without_effect", "with_effect", "standard_errors")
    return {name: dict(zip(keys, row, strict=True))
            for name, row in zip(base.names, rows.tolist(), strict=True)}


def _where(study: _Study) -> tuple[Region, ...]:
    boxes, found = study.boxes, study.found
    if not study.significant or not len(boxes):
        return ()
    # A region and the rest of the space show the same step: name the smaller of the two.
    large = boxes.members.sum(axis=1) > boxes.members.shape[1] / 2
    order = np.argsort(-np.abs(found.region_z) * np.where(large, _LARGE_REGION, 1.0))
    clear = order[found.region_p[order] <= REGION_SIGNIFICANCE]
    chosen: list[int] = []
    # Where no place is significant by itself the first one is named all the same, with its p.
    for i in (clear if len(clear) else order[:1]).tolist():
        shared = (np.sum(boxes.members[i] & boxes.members[chosen], axis=1)
                  / np.minimum(boxes.members[i].sum(), boxes.members[chosen].sum(axis=1)))
        if (shared <= _OVERLAP).all() and len(chosen) < _MOST_REGIONS:
            chosen.append(i)
    observed = study.base.observed
    residual, count = study.base.whitened[0] * observed.scale[0], observed.count
    # Cells end before the samples in them do.
    place, whole = observed.place, observed.whole.place
    low = np.where(boxes.low == place.min(axis=1), whole.min(axis=1), boxes.low)
    high = np.where(boxes.high == place.max(axis=1), whole.max(axis=1), boxes.high)
    limits = np.stack([low, high], axis=-1).tolist()
    return tuple(Region(
        {axis.name: (low, high) for axis, (low, high) in zip(observed.steered, limits[i],
                                                             strict=True)},
        float(np.average(residual[boxes.members[i]], weights=count[boxes.members[i]])),
        int(count[boxes.members[i]].sum()),
        float(found.region_p[i]), observed.readings[found.region_channel[i]].channel.name)
        for i in chosen)


def _at_zero(fit: Fit) -> list[str]:
    base = fit.hypothesis.system.base
    return [f"the refit puts {name} at zero: something else takes its place"
            for name, value, low in zip(base.names, base.values(fit.base), base.values(base.low),
                                        strict=True) if low == 0.0 and value <= _ZERO]


def _on_noise(study: _Study) -> list[str]:
    """Say that the noise found is not the one stated, or what a statement would change."""
    observed = study.base.observed
    channel, stated, found = observed.readings[0].channel, observed.whole.usual_noise, study.scatter
    ratio = found / stated
    if observed.assumed and len(observed.whole) < FEW:
        noise = float(f"{stated:.2g}")
        believed = refit(study.base.hypothesis, observed.stating(noise))
        p_value = significance(believed, study.boxes, study.seed).p_value
        return [f"nobody stated the noise, and {len(observed)} samples cannot tell it from a gap: "
                f"the verdict rests on an assumption; if the noise is known to be "
                f"{channel.factor * noise:.2g} {channel.unit}, --noise {noise:g} gives p = "
                f"{p_value:.2g}"]
    if 0.75 < ratio < 1.33:
        return []
    if not observed.assumed:
        return [f"the noise looks {ratio:.2f} times the one stated ({observed.noise_source}): "
                "check the statement"]
    return [f"nobody stated the noise; it looks like {channel.factor * found:.2g} {channel.unit}, "
            f"{ratio:.2f} times what is assumed: --noise {found:.2g} states that"]

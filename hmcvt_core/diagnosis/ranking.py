# SPDX-License-Identifier: Apache-2.0
"""Which competitor explains a gap: posterior probabilities over effects, pairs and the unlisted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..physics.effects.base import Effect
from .candidates import Bench, Candidate, Linear
from .evidence import log_mean
from .hypothesis import forms_of
from .regions import Regions

Array = NDArray[np.float64]

CONTRACT_EFFECTS = frozenset({
    "charge_pump", "churning", "clutch_drag", "gear_mesh", "planetary_mesh", "pressure_leakage",
    "pressure_friction", "compressibility", "displacement_error", "oil_temperature",
    "torque_sensor",
})
_RARE = 0.15  # prior of other effects against those that the field meets most
_BENCH_FIRST = 2.0  # a meter is wrong more often than any one part
PRIOR_UNLISTED = 0.10
_PRIOR_PAIR = 0.10  # that a gap has two causes
_CLEAR = 4.0  # squared gap / squared noise of a channel that certainly shows one
_LEADERS = 5
_PAIRS = 8


@dataclass(frozen=True, eq=False)
class Ranking:
    """Competitors weighed.

    Attributes:
        probability: that an effect is present, by name, most probable first.
        best: the most likely candidate that holds each effect, by name.
        leading: the most likely candidate of all, single or pair.
        unlisted: probability of a loss that nobody listed.
        leftover: log evidence that something smooth is left beside the leading candidate.
        explained: part of the squared gap that the leading candidate removes from each channel,
            shape (channels,), from the refits; NaN for a channel without a clear gap.
        pure: lowest noise variance that any competitor leaves, in stated ones, (channels,).
        singles: one refitted candidate per form tried, best first.
        pairs: refitted pairs, best first.
        nothing: the base model alone.
        field: the best smooth field.
    """

    probability: dict[str, float]
    best: dict[str, Candidate]
    leading: Candidate
    unlisted: float
    leftover: float
    explained: Array
    pure: Array
    singles: tuple[Candidate, ...]
    pairs: tuple[Candidate, ...]
    nothing: Linear
    field: Linear


def rank(bench: Bench, boxes: Regions, singles: Sequence[Candidate], paired: bool) -> Ranking:
    """Weigh every competitor; `paired` lets pairs of effects compete too."""
    nothing = bench.nothing()
    fields = bench.fields(nothing)
    unlisted = _unlisted_log(bench, boxes, fields, nothing)
    families = _by_names(singles)
    pairs = _pairs(bench, singles) if paired else []
    couples = _by_names(pairs)
    logs: dict[tuple[str, ...], float] = {}
    names = sorted({name for key in families for name in key})
    weight = {name: 1.0 if name in CONTRACT_EFFECTS else _RARE for name in names}
    weight["torque_sensor"] = _BENCH_FIRST
    total = sum(weight.values())
    for key, members in families.items():
        prior = (1.0 - PRIOR_UNLISTED) * weight[key[0]] / total
        logs[key] = np.log(prior) + log_mean(np.array([item.log for item in members]))
    for key, members in couples.items():
        first, second = (weight[name] / total for name in key)
        logs[key] = (np.log(_PRIOR_PAIR * 2.0 * first * second)
                     + log_mean(np.array([item.log for item in members])))
    logs[()] = np.log(PRIOR_UNLISTED) + unlisted
    values = np.array(list(logs.values()))
    posterior = dict(zip(logs, np.exp(values - values.max()) / np.sum(
        np.exp(values - values.max())), strict=True))
    everyone = [*singles, *pairs]
    probability: dict[str, float] = {}
    best: dict[str, Candidate] = {}
    for name in sorted({name for key in logs for name in key}):
        probability[name] = float(sum(p for key, p in posterior.items() if name in key))
        holders = [(posterior[_key(item)], item.log, item) for item in everyone
                   if name in item.names]
        best[name] = max(holders, key=lambda entry: entry[:2])[2]
    order = sorted(probability, key=lambda name: -probability[name])
    named = {key: p for key, p in posterior.items() if key}
    top = max(named, key=lambda key: named[key])
    leading = max((item for item in everyone if _key(item) == top), key=lambda item: item.log)
    return Ranking({name: probability[name] for name in order}, best, leading,
                   float(posterior[()]), *_left(bench, boxes, leading, nothing), tuple(singles),
                   tuple(pairs), nothing, max(fields, key=lambda item: item.log))


def _left(
    bench: Bench, boxes: Regions, leading: Candidate, nothing: Linear
) -> tuple[float, Array, Array]:
    """What the leading candidate leaves: `leftover`, `explained` and `pure` of `Ranking`."""
    fields = bench.fields(leading.linear)
    leftover = log_mean(np.array([item.log for item in fields])) - leading.linear.log
    noises = [item.found.noise[0] for item in (leading.linear, *fields)]
    if len(boxes):
        noises += [bench.steps(boxes, base, channel)[1] for channel in range(bench.channels)
                   for base in (nothing, leading.plain)]
    pure = np.min(noises, axis=0)
    before, after = nothing.found.noise[0] - pure, leading.plain.found.noise[0] - pure
    # A channel whose scatter hardly grows without the cause had no gap to remove.
    clear = before > _CLEAR * pure
    explained = np.where(clear, 1.0 - after / np.where(clear, before, 1.0), np.nan)
    return leftover, explained, pure


def single_candidates(bench: Bench) -> list[Candidate]:
    """Refit one form of every kind of effect, and every form of the leading kinds."""
    screened = bench.screen(bench.kinds, bench.base)
    by_kind: dict[type[Effect], list[Effect]] = {}
    for _, form, _ in screened:
        by_kind.setdefault(type(form), []).append(form)
    # The screen is linear: good enough to pick a shape within a kind, not to drop a kind.
    found = [bench.candidate((forms[0],)) for forms in by_kind.values()]
    found.sort(key=lambda item: -item.log)
    for item in list(found[:_LEADERS]):
        kind = type(item.effects[0])
        done = by_kind[kind][0]
        found += [bench.candidate((form,)) for form in forms_of(kind) if form != done]
    return sorted(found, key=lambda item: -item.log)


def _pairs(bench: Bench, singles: Sequence[Candidate]) -> list[Candidate]:
    kinds = bench.kinds
    screened: list[tuple[float, tuple[Effect, ...]]] = []
    leaders: dict[str, Candidate] = {}
    for item in singles:
        leaders.setdefault(item.names[0], item)
    for item in list(leaders.values())[:_LEADERS]:
        others = [kind for kind in kinds if kind.name != item.names[0]]
        for log, form, _ in bench.screen(others, item.fit, item.effects)[:_PAIRS]:
            screened.append((log, (*item.effects, form)))
    screened.sort(key=lambda entry: -entry[0])
    pairs, seen = [], set()
    for _, effects in screened:
        key = frozenset((effect.name, effect.form) for effect in effects)
        if key in seen:
            continue
        seen.add(key)
        pairs.append(bench.candidate(effects))
        if len(pairs) == _PAIRS:
            break
    return sorted(pairs, key=lambda item: -item.log)


def _unlisted_log(
    bench: Bench, boxes: Regions, fields: Sequence[Linear], nothing: Linear
) -> float:
    smooth = log_mean(np.array([item.log for item in fields]))
    if not len(boxes):
        return smooth
    steps = log_mean(np.concatenate([bench.steps(boxes, nothing, channel)[0]
                                     for channel in range(bench.channels)]))
    return float(np.logaddexp(smooth, steps) - np.log(2.0))


def _key(item: Candidate) -> tuple[str, ...]:
    return tuple(sorted(item.names))


def _by_names(items: Sequence[Candidate]) -> dict[tuple[str, ...], list[Candidate]]:
    groups: dict[tuple[str, ...], list[Candidate]] = {}
    for item in items:
        groups.setdefault(_key(item), []).append(item)
    return groups

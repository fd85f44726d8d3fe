# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of the gap between model and bench: where, which effect, how far it shrinks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.bench import BenchSamples
from ..model.domain import AXES, Domain
from ..model.model import EfficiencyModel
from ..model.plausibility import output_speed_remark
from ..transmission.parameters import PARAMETER_NAMES
from .candidates import Bench, Candidate
from .holdout import errors_on, fresh
from .hypothesis import BASE_SIZE, Hypothesis
from .intake import admitted
from .next_tests import next_tests
from .observations import FEW, Observations
from .ranking import Ranking, rank, single_candidates
from .regions import Regions, regions
from .result import (
    GAP_SIGNIFICANCE,
    REGION_SIGNIFICANCE,
    Cause,
    Diagnosis,
    Gap,
    Region,
    ShrinkageSummary,
)
from .shrinkage import Shrinkage, averaged_errors, deals, shrinkage
from .significance import Significance, basis, significance

Array = NDArray[np.float64]

FOUND = 0.80
"""Probability from which one cause is called found."""

SET_PROBABILITY = 0.97
"""The set that cannot be told apart holds the cause with this probability, if it is listed."""

ADEQUATE = 0.5
"""Part of the gap that a named cause must remove; else the gap is unexplained."""

ADEQUATE_SPEED = 0.8
"""The same for the squared gap of the output speed, which is read so much more exactly."""

UNLISTED = 0.2
"""Probability of an unlisted effect from which a poor cause is not named."""

LEFTOVER = 5.0
"""Log evidence from which something is left beside the leading cause."""

_LARGE_REGION = 0.8  # discount of a region with most of the samples
_MOST_REGIONS = 5
_OVERLAP = 0.2
_RIVALS = 12


def diagnose(
    model: EfficiencyModel,
    samples: BenchSamples,
    holdout: BenchSamples | None = None,
    *,
    noise: float | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between a model and a bench.

    The base parameters of `model` are refitted first: a gap that a refit closes is no gap.

    Args:
        model: formulation `power_balance`; effects it already has stay.
        samples: at least five bench samples; output speed and oil temperature are used if there.
        holdout: samples to measure the shrinkage on, with their own noise if they state any; None
            for cross-validation.
        noise: standard deviation of the efficiency [-]; None takes column `efficiency_std`,
            repeated points, or the paper's 1.12 %, in this order.
        seed: of every random number.
        progress: called with a line of text before each step; may raise to cancel.

    Raises:
        InputError: samples cannot carry a diagnosis, the holdout lacks a column or holds
            nothing new, or the formulation is another.
    """
    bench, notes = admitted(model, samples, noise)
    if holdout is not None:
        holdout, more = fresh(holdout, samples)
        notes += more
    tell = progress if progress is not None else _silence
    boxes = regions(bench.observed.samples)
    tell("step 1 of 4, is there a gap")
    found = _significance(bench, boxes, seed)
    significant = found.p_value <= GAP_SIGNIFICANCE
    tell("step 2 of 4, refits with each effect")
    singles = single_candidates(bench)
    ranking = rank(bench, boxes, singles, paired=False)
    if significant and (ranking.unlisted > 0.01 or ranking.leftover > LEFTOVER):
        tell("step 3 of 4, refits with pairs of effects")
        ranking = rank(bench, boxes, singles, paired=True)
    tell("step 4 of 4, how far the gap shrinks")
    return _Assembly(bench, boxes, found, significant, ranking, holdout, seed, notes).diagnosis()


def _silence(text: str) -> None:
    """Nobody asked."""


def _significance(bench: Bench, boxes: Regions, seed: int) -> Significance:
    columns, spread = bench.shared(bench.base)
    screened = bench.screen(bench.kinds, bench.base)
    signatures = np.stack([linear.columns[..., -1] for _, _, linear in screened])
    noise = bench.base.noise
    return significance(basis(columns, spread, noise), bench.target(bench.base), noise,
                        bench.observed, boxes, signatures, seed)


class _Assembly:
    """Turns what was found into a `Diagnosis`."""

    def __init__(
        self,
        bench: Bench,
        boxes: Regions,
        found: Significance,
        significant: bool,
        ranking: Ranking,
        holdout: BenchSamples | None,
        seed: int,
        notes: tuple[str, ...],
    ) -> None:
        self.notes = notes
        self.bench, self.boxes, self.found = bench, boxes, found
        self.significant, self.ranking, self.seed = significant, ranking, seed
        self.holdout, self.first = holdout, ranking.best[next(iter(ranking.probability))]
        self.observed = bench.observed
        self.dealt = deals(self.observed, seed)
        self.noise = self._noise()
        self.before = averaged_errors([ranking.nothing], self.observed, self.dealt)

    def _noise(self) -> Array:
        """Standard deviation of the efficiency, shape (n,), from the best competitor of all."""
        ranking = self.ranking
        if self.significant and ranking.unlisted > 0.5:
            # A narrow band would pass as noise for every competitor without one.
            return np.asarray(self.observed.scale[0] * np.sqrt(ranking.pure[0]))
        rivals = [ranking.nothing, ranking.field, ranking.leading.linear]
        best = max(rivals, key=lambda item: item.log) if self.significant else ranking.nothing
        return np.asarray(self.observed.scale[0] * np.sqrt(best.found.noise[0, 0]))

    def diagnosis(self) -> Diagnosis:
        """Put everything together."""
        shrunk = self._shrinkage(self._rivals())
        verdict, why = self._verdict(shrunk)
        causes = self._causes(verdict) if self.significant else ()
        noise = float(np.sqrt(np.mean(self.noise**2)))
        gap = Gap(len(self.observed.samples), float(np.sqrt(np.mean(self.before**2))), noise,
                  float(np.sqrt(np.mean(self.observed.scale[0] ** 2))),
                  self.observed.noise_source, self.found.p_value, self.significant)
        named = verdict in ("cause_found", "ambiguous")
        tests = next_tests(self.bench, self.ranking) if self.significant else ()
        return Diagnosis(
            gap, self._where(), causes[0].component if named else None, verdict, causes,
            ShrinkageSummary(shrunk.before, shrunk.after, shrunk.fraction, shrunk.interval,
                             shrunk.on),
            tests, self.ranking.unlisted if self.significant else 0.0, self._notes(why),
            self._model(np.empty(0), (), self.bench.base.base), self.observed.samples,
            shrunk.errors_before, shrunk.errors_after,
        )

    # --- verdict --------------------------------------------------------------------------------

    def _verdict(self, shrunk: Shrinkage) -> tuple[str, str]:
        """Return the verdict, and why no cause is named."""
        if not self.significant:
            return "no_gap", ""
        ranking = self.ranking
        known = next(iter(ranking.probability.values()))
        removed = shrunk.fraction if shrunk.fraction is not None else 0.0
        # NaN, and so False in either comparison, where the output speed shows no clear gap.
        speed = ranking.explained[1] if self.bench.channels > 1 else np.nan
        wanting = ranking.unlisted > UNLISTED or ranking.leftover > LEFTOVER
        if ranking.unlisted > 0.5 or (removed < ADEQUATE and wanting):
            return "unexplained", "no listed effect removes most of the gap: look at the regions"
        if speed < ADEQUATE_SPEED:
            return "unexplained", (
                f"the best of the listed effects explains {max(0.0, 100.0 * speed):.0f} % of what "
                "the output speed shows: look at the regions")
        adequate = removed >= ADEQUATE or speed >= ADEQUATE_SPEED
        return "cause_found" if known >= FOUND and adequate else "ambiguous", ""

    # --- shrinkage ------------------------------------------------------------------------------

    def _rivals(self) -> Sequence[Candidate]:
        if not self.significant:
            return ()
        everyone = [*self.ranking.pairs, *self.ranking.singles]
        everyone.sort(key=lambda item: -item.log)
        return everyone[:_RIVALS]

    def _shrinkage(self, rivals: Sequence[Candidate]) -> Shrinkage:
        if self.holdout is not None:
            return self._on_holdout(rivals)
        after = self.before
        if rivals:
            linear = [self.ranking.nothing, *(item.plain for item in rivals)]
            after = averaged_errors(linear, self.observed, self.dealt)
        return shrinkage(self.before, after, self.noise, "cross-validation", self.seed,
                         self.significant)

    def _on_holdout(self, rivals: Sequence[Candidate]) -> Shrinkage:
        assert self.holdout is not None
        base = self._model(np.empty(0), (), self.bench.base.base)
        # The model of the first cause: the one that is saved.
        after = self._model_of(self.first) if rivals else base
        held = errors_on(self.holdout, base, after, float(np.sqrt(np.mean(self.noise**2))))
        self.notes += held.notes
        return shrinkage(held.before, held.after, held.noise, "holdout", self.seed,
                         self.significant)

    # --- causes ---------------------------------------------------------------------------------

    def _causes(self, verdict: str) -> tuple[Cause, ...]:
        ranking = self.ranking
        names = [name for name, p in ranking.probability.items() if p >= 0.01]
        names = names or list(ranking.probability)[:1]
        if verdict == "unexplained":
            names = names[:3]
        return tuple(self._cause(name) for name in names[:6])

    def _cause(self, name: str) -> Cause:
        ranking = self.ranking
        item = ranking.best[name]
        index = item.names.index(name)
        effect = item.effects[index]
        after = averaged_errors([item.plain], self.observed, self.dealt)
        shrunk = shrinkage(self.before, after, self.noise, "cross-validation", self.seed)
        others = [other for other in item.names if other != name]
        return Cause(
            name, effect.form, effect.component, ranking.probability[name],
            self._twins(name), self._parameters(item, index), others[0] if others else None,
            shrunk.after, shrunk.fraction, self._drift(item), effect.summary, effect.source,
            effect.remedy, self._model_of(item),
        )

    def _twins(self, name: str) -> tuple[str, ...]:
        """Effects that these data cannot tell from one: the rest of the credible set."""
        probability = self.ranking.probability
        with_it = self.ranking.best[name].names
        total, chosen = 0.0, []
        wanted = SET_PROBABILITY * (1.0 - self.ranking.unlisted)
        for other, p in probability.items():
            if other in with_it and other != name:
                continue
            if total >= wanted:
                break
            total += p
            chosen.append(other)
        return tuple(other for other in chosen if other != name) if name in chosen else ()

    def _parameters(self, item: Candidate, index: int) -> dict[str, dict[str, Any]]:
        effect = item.effects[index]
        position = sum(len(other.sizes()) for other in item.effects[:index])
        values: dict[str, dict[str, Any]] = {}
        for parameter in effect.parameters():
            value = effect.values()[parameter.name]
            entry: dict[str, Any] = {"value": value, "unit": parameter.unit,
                                     "meaning": parameter.meaning}
            if parameter.is_size:
                column = item.fit.jacobian.shape[-1] - len(item.fit.sizes) + position
                error = float(np.sqrt(item.plain.found.covariance[0, column, column]))
                spread = 1.96 * error * parameter.typical
                entry["interval"] = [max(value - spread, parameter.low),
                                     min(value + spread, parameter.high)]
                entry["plausible"] = bool(
                    parameter.low < value < parameter.high
                    and abs(value) <= 5.0 * abs(parameter.typical))
                position += 1
            values[parameter.name] = entry
        return values

    def _drift(self, item: Candidate) -> dict[str, dict[str, float]]:
        before, after = self.bench.base.base, item.fit.base
        error = np.sqrt(np.diagonal(item.plain.found.covariance[0]))[:BASE_SIZE]
        drift = {}
        for i, name in enumerate(PARAMETER_NAMES):
            old, new = (float(10.0 ** value[0]) if i == 0 else float(value[i])
                        for value in (before, after))
            drift[name] = {"without_effect": old, "with_effect": new,
                           "standard_errors": float((before[i] - after[i]) / error[i])}
        return drift

    # --- the rest -------------------------------------------------------------------------------

    def _where(self) -> tuple[Region, ...]:
        if not self.significant or not len(self.boxes):
            return ()
        boxes, z = self.boxes, np.abs(self.found.region_z)
        # A region and the rest of the space show the same step: name the smaller of the two.
        large = boxes.members.sum(axis=1) > boxes.members.shape[1] / 2
        z = np.where(large, _LARGE_REGION * z, z)
        chosen: list[int] = []
        order = np.argsort(-z)
        clear = order[self.found.region_p[order] <= REGION_SIGNIFICANCE]
        # Where no place is significant by itself the first one is named all the same, with its p.
        for i in clear if len(clear) else order[:1]:
            shared = [np.sum(boxes.members[i] & boxes.members[j])
                      / min(boxes.members[i].sum(), boxes.members[j].sum()) for j in chosen]
            if all(part <= _OVERLAP for part in shared):
                chosen.append(int(i))
            if len(chosen) == _MOST_REGIONS:
                break
        residual = self.bench.base.whitened[0] * self.observed.scale[0]
        return tuple(self._region(i, residual) for i in chosen)

    def _region(self, i: int, residual: Array) -> Region:
        boxes = self.boxes
        limits = [(float(boxes.low[i, axis]), float(boxes.high[i, axis]))
                  for axis in range(len(AXES))]
        inside = boxes.members[i]
        return Region(limits[0], limits[1], limits[2], float(residual[inside].mean()),
                      int(inside.sum()), float(self.found.region_p[i]),
                      self.observed.channels[self.found.region_channel[i]].name)

    def _model_of(self, item: Candidate) -> EfficiencyModel:
        return self._model(item.fit.sizes, item.effects, item.fit.base)

    def _model(self, sizes: Array, effects: Sequence[Any], base: Array) -> EfficiencyModel:
        hypothesis = Hypothesis(self.bench.model, tuple(effects))
        samples = self.observed.samples
        return replace(
            hypothesis.model_at(base, sizes), standard_errors={}, correlation=None,
            domain=Domain.of(samples),
            provenance={"source": "hmcvt diagnose", "data": samples.source.rsplit("/", 1)[-1],
                        "data_sha256": samples.sha256, "samples": len(samples)})

    def _notes(self, why: str) -> tuple[str, ...]:
        notes = list(self.notes)
        ratio = float(np.sqrt(np.mean(self.noise**2) / np.mean(self.observed.scale[0] ** 2)))
        rests = self._rests_on_assumption()
        if rests:
            notes += rests
        elif not 0.75 < ratio < 1.33:
            notes.append(self._noise_remark(ratio))
        remark = output_speed_remark(self.bench.model.stage, self.observed.samples)
        if remark is not None:
            notes.append(remark)
        samples = self.observed.samples
        if samples.output_speed is None:
            notes.append("without column output_speed, losses of flow and of torque look alike")
        if samples.oil_temperature is None:
            notes.append("without column oil_temperature, viscosity cannot be judged")
        refitted = self._model(np.empty(0), (), self.bench.base.base).parameters
        for name in ("motor_damping", "pump_damping"):
            if getattr(refitted, name) <= 1e-9:
                notes.append(f"the refit puts {name} at zero: something else takes its place")
        return (*notes, why) if why else tuple(notes)

    def _noise_remark(self, ratio: float) -> str:
        """Say that the noise found is not the one stated, nor the one assumed."""
        if not self.observed.assumed:
            return (f"the noise looks {ratio:.2f} times the one stated "
                    f"({self.observed.noise_source}): check the statement")
        found = float(np.sqrt(np.mean(self.noise**2)))
        return (f"nobody stated the noise; it looks like {100 * found:.2g} points, {ratio:.2f} "
                f"times what is assumed: --noise {found:.2g} states that")

    def _rests_on_assumption(self) -> list[str]:
        """Say what a statement of the noise would change where nobody made one."""
        if not self.observed.assumed or len(self.observed.samples) >= FEW:
            return []
        size = float(np.sqrt(np.mean(self.observed.scale[0] ** 2)))
        noise = float(f"{size:.2g}")
        stated = Bench(self.bench.model, Observations.of(self.observed.samples, noise))
        p_value = _significance(stated, self.boxes, self.seed).p_value
        return [f"nobody stated the noise, and {len(self.observed.samples)} samples cannot tell "
                f"it from a gap: the verdict rests on an assumption; if the noise is known to be "
                f"{100 * noise:.2g} points, --noise {noise:g} gives p = {p_value:.2g}"]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a statistician finds who knows every form of the plant, its base and its meters.

Each set of up to three effects is fitted by least squares to the readings, with the plant's own
forms; base parameters and errors of the meters are projected out. The evidence of a set has a
half-normal prior of the sizes. The shapes that are hidden are among the candidates, so that the
answer is an upper bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.stats import norm

from studies.blind.bench.classes import classes_of
from studies.blind.effect import Effect, FloatArray
from studies.blind.renewed.campaign import Campaign
from studies.blind.renewed.listed import OWN_FORMS, FanDrive, ReliefValve
from studies.blind.renewed.look import Look
from studies.blind.renewed.unlisted import UNLISTED, Accessory

#: Prior probability that nothing, one, two or three effects are hidden.
_COUNTS = (0.25, 0.4, 0.25, 0.1)
#: Size, as a shift of the efficiency, that is one deviation of its prior [-].
_SHIFT = 0.015
#: Random shapes of each form, next to those hidden.
_SHAPES = 2
#: Candidates that pairs and triples are made of, and sets that are fitted again by the plant.
_LEADERS = 24
_REFITTED = 6
_ITERATIONS = 2
_LOG_TINY = -745.0


@dataclass(frozen=True)
class Candidate:
    """A form with its shape, at the size of one deviation of the prior.

    Attributes:
        effect: the form.
        prior: share of its name that this shape has.
    """

    effect: Effect
    prior: float


@dataclass(frozen=True)
class OracleAnswer:
    """What the oracle finds.

    Attributes:
        sets: classes of each set with its probability, the first ones.
    """

    sets: list[tuple[list[str], float]]

    def to_dict(self) -> dict[str, object]:
        """Return it as plain data."""
        return {"oracle": [[classes, p] for classes, p in self.sets]}


def ask(campaign: Campaign, look: Look) -> OracleAnswer:
    """Return the sets that the readings of a campaign support."""
    return _Oracle(campaign, look).answer()


class _Oracle:
    """Evidence of every set of effects for one campaign."""

    def __init__(self, campaign: Campaign, look: Look) -> None:
        self.campaign = campaign
        self.look = look
        self.changes: list[FloatArray] = []
        self.candidates = self._draw()
        self.target = look.observed() - look.bare
        stacked = np.column_stack([*self.changes, self.target])
        left = look.remaining(stacked)
        self.ways = left[:, :-1]
        self.rest = left[:, -1]

    def _draw(self) -> list[Candidate]:
        """Return candidates of every name, the hidden shapes among them."""
        rng = np.random.default_rng([self.campaign.seed, 4242])
        kinds: list[type[Effect]] = [*OWN_FORMS.values(), *UNLISTED.values(), Accessory]
        hidden = {effect.name: effect for effect in self.campaign.truth.effects}
        candidates = []
        for kind in kinds:
            for variant in kind.variants or ("",):
                shapes = [
                    self._placed(kind(variant=variant).drawn(rng))
                    for _ in range(_SHAPES)
                ]
                true = hidden.get(kind.name)
                if true is not None and true.variant == variant:
                    shapes.append(replace(true, size=1.0))
                count = len(shapes) * len(kind.variants or ("",))
                for effect in shapes:
                    for turned in self._either_sense(effect):
                        candidates.append(self._scaled(turned, 1.0 / count))
        return candidates

    def _placed(self, effect: Effect) -> Effect:
        """Return an effect whose threshold lies where campaigns have it."""
        pressure = np.abs(self.campaign.state.pressure)
        if isinstance(effect, ReliefValve):
            cracking = float(np.nanquantile(pressure, effect.quantile))
            return replace(effect, cracking=cracking)
        if isinstance(effect, FanDrive):
            mean = float(np.mean(self.campaign.settings.oil_temperature))
            return replace(effect, mean_temperature=mean)
        return effect

    def _either_sense(self, effect: Effect) -> list[Effect]:
        if not hasattr(effect, "sense"):
            return [effect]
        senses: list[dict[str, Any]] = [{"sense": sense} for sense in (-1.0, 1.0)]
        return [replace(effect, **sense) for sense in senses]

    def _scaled(self, effect: Effect, prior: float) -> Candidate:
        """Return a candidate at the size that shifts the efficiency by one deviation."""
        trial = replace(effect, size=min(0.5, effect.limit) * effect.size)
        count = len(self.campaign.programme)
        change = self.look.change([trial])
        shift = change[:count] * self.look.efficiency_deviation
        mean = float(np.sqrt(np.mean(shift**2)))
        # A form that does next to nothing keeps a size that is possible.
        factor = min(_SHIFT / max(mean, 1e-9), effect.limit / abs(trial.size))
        # In proportion; the leading sets are run again at their sizes.
        self.changes.append(factor * change)
        return Candidate(replace(trial, size=trial.size * factor), prior)

    # --- evidence -----------------------------------------------------------------------------

    def answer(self) -> OracleAnswer:
        """Return the sets with their probabilities."""
        logs: dict[tuple[int, ...], float] = {(): self._prior(())}
        for i in range(len(self.candidates)):
            logs[(i,)] = self._log((i,))
        for i, j in combinations(range(len(self.candidates)), 2):
            if self._different((i, j)):
                logs[(i, j)] = self._log((i, j))
        for pair in self._best(logs, 2):
            for k in range(len(self.candidates)):
                triple = tuple(sorted({*pair, k}))
                if len(triple) == 3 and triple not in logs and self._different(triple):
                    logs[triple] = self._log(triple)
        for members in self._to_refit(logs):
            logs[members] = self._refitted(members)
        return OracleAnswer(self._summed(logs))

    def _different(self, members: Sequence[int]) -> bool:
        names = {self.candidates[i].effect.name for i in members}
        return len(names) == len(members)

    def _best(
        self, logs: dict[tuple[int, ...], float], count: int
    ) -> list[tuple[int, ...]]:
        chosen = [members for members in logs if len(members) == count]
        return sorted(chosen, key=lambda members: -logs[members])[:_LEADERS]

    def _to_refit(self, logs: dict[tuple[int, ...], float]) -> list[tuple[int, ...]]:
        """Return the leading sets, of each set of names the best one."""
        seen = set()
        chosen = []
        for members in sorted(logs, key=lambda members: -logs[members]):
            names = tuple(sorted(self.candidates[i].effect.name for i in members))
            if members and names not in seen:
                seen.add(names)
                chosen.append(members)
            if len(chosen) == _REFITTED:
                break
        hidden = self._hidden()
        return chosen if hidden is None or hidden in chosen else [*chosen, hidden]

    def _hidden(self) -> tuple[int, ...] | None:
        """Return the candidates that are hidden, with their shapes; None if there are none."""
        members = []
        for true in self.campaign.truth.effects:
            for i, item in enumerate(self.candidates):
                if item.effect == replace(true, size=item.effect.size):
                    members.append(i)
        return tuple(sorted(members)) or None

    def _prior(self, members: Sequence[int]) -> float:
        """Log prior of a set with its shapes."""
        names = len(OWN_FORMS) + len(UNLISTED) + 1
        count = len(members)
        sets = 1.0
        for k in range(count):
            sets *= (names - k) / (k + 1.0)
        shapes = [self.candidates[i].prior for i in members]
        return float(np.log(_COUNTS[count] / sets) + np.sum(np.log(shapes)))

    def _log(self, members: tuple[int, ...]) -> float:
        """Log posterior of a set, linear in its sizes."""
        ways = self.ways[:, list(members)]
        evidence, _ = _half_normal_evidence(ways, self.rest)
        return self._prior(members) + evidence

    def _refitted(self, members: tuple[int, ...]) -> float:
        """Log posterior of a set, with the plant run at the fitted sizes."""
        effects = [self.candidates[i].effect for i in members]
        _, sizes = _half_normal_evidence(self.ways[:, list(members)], self.rest)
        evidence = float("-inf")
        for _ in range(_ITERATIONS):
            bounds = [effect.limit / abs(effect.size) for effect in effects]
            sizes = np.clip(sizes, 1e-3, bounds)
            scaled = [
                replace(effect, size=effect.size * size)
                for effect, size in zip(effects, sizes, strict=True)
            ]
            whole = self.look.change(scaled)
            ways = []
            for number, size in enumerate(sizes):
                others = scaled[:number] + scaled[number + 1 :]
                ways.append((whole - self.look.change(others)) / size)
            stacked = np.column_stack([*ways, self.target - whole])
            left = self.look.remaining(stacked)
            slopes = left[:, :-1]
            rest = left[:, -1] + slopes @ sizes
            evidence, sizes = _half_normal_evidence(slopes, rest)
        # Both ends of the comparison are measured against the same empty set.
        return self._prior(members) + evidence + self._gain_of(rest)

    def _gain_of(self, rest: FloatArray) -> float:
        """Return what the empty set gains by a target that is taken at other sizes."""
        return 0.5 * float(self.rest @ self.rest - rest @ rest)

    def _summed(
        self, logs: dict[tuple[int, ...], float]
    ) -> list[tuple[list[str], float]]:
        """Sum up the sets by their classes, the most probable first."""
        output_coupled = self.campaign.layout.output_coupled
        top = max(logs.values())
        total: dict[tuple[str, ...], float] = {}
        for members, value in logs.items():
            effects = [self.candidates[i].effect for i in members]
            forms = {effect.name: effect.variant for effect in effects}
            names = [effect.name for effect in effects]
            key = tuple(classes_of(names, forms, output_coupled))
            weight = np.exp(max(value - top, _LOG_TINY))
            total[key] = total.get(key, 0.0) + float(weight)
        whole = sum(total.values())
        ranked = sorted(total.items(), key=lambda entry: -entry[1])
        return [(list(classes), weight / whole) for classes, weight in ranked[:5]]


def _half_normal_evidence(
    ways: FloatArray, rest: FloatArray
) -> tuple[float, FloatArray]:
    """Return the log evidence against the empty set, and the fitted sizes.

    Args:
        ways: change of the readings by one deviation of each size, shape (rows, k).
        rest: readings beyond the base, shape (rows,).
    """
    count = ways.shape[1]
    if count == 0:
        return 0.0, np.empty(0)
    precision = ways.T @ ways + np.eye(count)
    covariance = np.linalg.inv(precision)
    pull = ways.T @ rest
    mean = covariance @ pull
    _, log_determinant = np.linalg.slogdet(precision)
    positive = norm.logcdf(mean / np.sqrt(np.diag(covariance)))
    inside = float(np.sum(positive)) + count * np.log(2.0)
    if np.min(mean) < 0.0:
        # Where a size would be negative the best possible one is next to zero.
        inside = max(inside, -0.5 * float(pull @ mean) - 5.0)
    evidence = 0.5 * float(pull @ mean) - 0.5 * float(log_determinant) + inside
    return evidence, mean

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Which test to run next, and when to stop.

A test is worth the information that its readings are expected to give on which explanation is the
right one. Every explanation alive (the unlisted and "no gap" among them) foretells a Gaussian, with
the allowances by which its evidence will be judged; the information that a mixture of Gaussians
holds on its component is bounded from below by

.. math:: I \ge -\sum_k p_k \ln \sum_j p_j e^{-B_{kj}}

B_kj being the Bhattacharyya distance of two components (Kolchinsky & Tracey 2017, Entropy 19, 361).
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..selection.explanation import Explanation
from ..selection.posterior import Posterior
from ..selection.prediction import Prediction
from ..selection.search import Names
from ..settings import (
    DESIGN_EXPLANATIONS,
    DESIGN_MAJORITY,
    DESIGN_TESTS,
    MANY_TESTS,
    RELEVANT_PROBABILITY,
    SETTLED_LOG_ODDS,
    SETTLED_PROBABILITY,
)
from ..system import Array, Axis, Points

_NO_TEST = "cannot be settled by tests"
_REGIONS = "look at the regions that hmcvt diagnose tells"


def named(effects: Names | None) -> str:
    """Return a set of effects in words; () is an unlisted loss, None no gap."""
    if effects is None:
        return "no gap"
    return " + ".join(effects).replace("_", " ") or "something unlisted"


@dataclass(frozen=True)
class NextTest:
    """A test worth making.

    Attributes:
        point: where, by the name of the axis; None when no point helps.
        separates: the two explanations it tells apart best, each its effects in words.
        gain: information expected on which explanation is right [nats].
        measure: a calibration or measurement beside the plan, or None.
        setting: label along each axis that has some.
    """

    point: Mapping[str, float] | None
    separates: tuple[str, str]
    gain: float
    measure: str | None = None
    setting: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Advice:
    """What to measure next.

    Attributes:
        reason: to stop, `settled`, `cannot be settled by tests` or `no gap worth a test`; None
            where a further test is worth making.
        tests: the next one, and what may be made along with it; empty where none helps.
        measure: what settles it where no test can, or None.
        parted: the two explanations that it tells apart, in words; None for the likeliest.
        tests_expected: how many more, by the first; 0 where no test helps.
        channels: to be read there.
        alive: effects and probability of each explanation, best first; the one without a name is an
            unlisted loss, and `no_gap` that of none.
        no_gap: probability that there is none, or none larger than a base that is a little off.
        axes: of the tests.
        notes: on the campaign; what the readings do not fit goes first.
    """

    reason: str | None = None
    tests: tuple[NextTest, ...] = ()
    measure: str | None = None
    parted: tuple[str, str] | None = None
    tests_expected: int = 0
    channels: tuple[str, ...] = ()
    alive: tuple[tuple[Names, float], ...] = ()
    no_gap: float = 0.0
    axes: tuple[Axis, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def stop(self) -> bool:
        """Whether no further test is worth making."""
        return self.reason is not None

    @property
    def next_tests(self) -> tuple[NextTest, ...]:
        """The tests, and the measurement that settles it where none does."""
        if self.measure is None or len(self.alive) < 2:
            return self.tests
        first, second = self.parted or (named(names) for names, _ in self.alive[:2])
        return *self.tests, NextTest(None, (first, second), 0.0, self.measure)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt next --json`."""
        return {
            "stop": self.stop,
            "reason": self.reason,
            "test": {
                **(self.tests[0].point or {}),
                "stage": None,
                **self.tests[0].setting,
                "channels": list(self.channels),
            }
            if self.tests and not self.stop
            else None,
            "measure": self.measure,
            "alive": [
                {"effects": list(names), "probability": p} for names, p in self.alive
            ],
            "no_gap_probability": self.no_gap,
            "tests_expected": self.tests_expected,
            "notes": list(self.notes),
        }


def advise(ranking: Posterior, possible: Points) -> Advice:
    """Choose the next tests, each knowing of those before it.

    Args:
        ranking: of the explanations.
        possible: the tests that can be run, by axis.
    """
    from scipy.special import logit, xlogy

    labels, base = _labels(ranking), ranking.base_only.fit
    alive = tuple((names, p) for names, (_, p) in labels.items() if names is not None)
    answer = partial(
        Advice,
        channels=tuple(channel.name for channel in base.observed.channels),
        alive=alive,
        no_gap=labels[None][1],
        axes=base.observed.steered,
    )
    if labels[None][1] >= SETTLED_PROBABILITY:
        return answer("no gap worth a test")
    if alive[0][1] >= SETTLED_PROBABILITY:
        return answer("settled", measure=None if alive[0][0] else _REGIONS)
    p = np.array([each for _, each in labels.values()])
    p /= p.sum()
    likeliest, _ = max(labels.values(), key=lambda item: item[1])
    pool = replace(base, noise=likeliest.model.noise).observations_at(possible)
    rivals = [
        rival.prediction_at(pool, with_allowances=True) for rival, _ in labels.values()
    ]
    carried = np.stack([np.isfinite(each.mean).all(axis=0) for each in rivals])
    able = carried[-1] & (p @ carried > DESIGN_MAJORITY)  # by the base, and by most
    if not able.any():
        return answer(_NO_TEST, measure="none of the tests can be carried")
    place = {name: row[able] for name, row in pool.points.items()}
    carried = carried[:, able]
    # Who cannot carry a load has no say there.
    rivals = [
        each._replace(
            mean=np.where(own, each.mean[:, able], 0.0),
            columns=np.where(own[:, None], each.columns[:, able], 0.0),
        )
        for each, own in zip(rivals, carried, strict=True)
    ]
    names = list(labels)
    twins = _untold(rivals, names, p)
    if p[list(twins)].sum() > DESIGN_MAJORITY:
        first = min(twins)  # they come most probable first
        rival, twin = (labels[names[i]][0] for i in (first, twins[first]))
        remedy = [
            effect.remedy
            for effect in (*rival.fit.effects, *twin.fit.effects)
            if effect.remedy and effect.name in {*rival.names} ^ {*twin.names}
        ]
        if remedy:
            return answer(
                _NO_TEST,
                measure="; or ".join(dict.fromkeys(remedy)),
                parted=(named(rival.names), named(twin.names)),
            )
    says = p[:, None] * carried
    says /= says.sum(axis=0)
    tests = []
    for _ in range(DESIGN_TESTS):
        distance = _distances(rivals)
        information = -xlogy(
            says, np.einsum("jn,kjn->kn", says, np.exp(-distance))
        ).sum(axis=0)
        best = int(np.argmax(information))
        weight = says[:, [best]] * says[:, best] * (1.0 - np.exp(-distance[:, :, best]))
        one, other = np.unravel_index(int(np.argmax(weight)), weight.shape)
        tests.append(
            NextTest(
                {axis.name: float(place[axis.name][best]) for axis in pool.steered},
                (named(names[one]), named(names[other])),
                float(information[best]),
                setting={
                    axis.name: axis.labels[int(place[axis.name][best])]
                    for axis in pool.axes
                    if axis.labels
                },
            )
        )
        rivals = [each.after_reading(best) for each in rivals]
    short = SETTLED_LOG_ODDS - logit(p.max())
    expected = math.ceil(
        np.clip(short / max(2.0 * tests[0].gain, 1e-9), 1.0, MANY_TESTS)
    )
    return answer(tests=tuple(tests), tests_expected=expected)


def _untold(
    rivals: Sequence[Prediction], names: Sequence[Names | None], p: Array
) -> dict[int, int]:
    """Explanations that many tests would not tell from another: by which of those.

    Of a set and a larger one one gives way to more samples, and so does an unlisted loss.
    """
    found = dict[int, int]()
    sets = [(i, {*own}) for i, own in enumerate(names) if own]
    for (i, one), (j, other) in itertools.combinations(sets, 2):
        if not (one < other or other < one):
            told = max(
                rivals[i].squared_distance(rivals[j], MANY_TESTS),
                rivals[j].squared_distance(rivals[i], MANY_TESTS),
            )
            for each, beside in ((i, j), (j, i)):
                if told < 2.0 * (SETTLED_LOG_ODDS - math.log(p[each] / p[beside])):
                    found.setdefault(each, beside)
    return found


def _labels(ranking: Posterior) -> dict[Names | None, tuple[Explanation, float]]:
    """The likeliest rival of each explanation and its probability; () unlisted, None no gap.

    Of a set the one without a loss beside it, if there is one; of an unlisted loss one that has it.
    """
    found: dict[Names | None, tuple[Explanation, float]] = {}
    for rival, p in ranking.entries:
        part = rival.explained_fraction(ranking.base_only)
        for label, share in (
            (rival.names, part),
            (None if rival.is_base else (), 1.0 - part),
        ):
            if share:
                first, total = found.get(label, (rival, 0.0))
                if first.is_listed_set != bool(label) and rival.is_listed_set == bool(
                    label
                ):
                    first = rival
                found[label] = first, total + (1.0 - ranking.no_gap) * share * p
    loose, misfit = found.pop(None, (ranking.base_only, 0.0))
    kept = sorted(
        (
            (names, item)
            for names, item in found.items()
            if item[1] >= RELEVANT_PROBABILITY
        ),
        key=lambda entry: -entry[1][1],
    )[:DESIGN_EXPLANATIONS]
    if not kept:  # the likeliest, however improbable
        kept = sorted(found.items(), key=lambda entry: -entry[1][1])[:1]
    return {
        **dict(kept),
        None: (
            loose if misfit > ranking.no_gap else ranking.base_only,
            ranking.no_gap + misfit,
        ),
    }


def _distances(rivals: Sequence[Prediction]) -> Array:
    """Bhattacharyya distances at each point, shape (k, k, points)."""
    mean = np.stack([each.mean.T for each in rivals])
    variance = np.stack([each.reading_covariance for each in rivals]) + np.eye(
        mean.shape[-1]
    )
    log = np.linalg.slogdet(variance)[1]
    middle = (variance[:, None] + variance) / 2.0
    miss = mean[:, None] - mean
    squared = np.einsum(
        "kjnc,kjnc->kjn", miss, np.linalg.solve(middle, miss[..., None])[..., 0]
    )
    return np.asarray(
        squared / 8.0
        + (np.linalg.slogdet(middle)[1] - (log[:, None] + log) / 2.0) / 2.0
    )

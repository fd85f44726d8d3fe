# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
r"""Which test to run next, and when to stop.

The value of a test is the information that its readings are expected to give on which explanation
is correct. Every relevant explanation (unlisted losses and "no gap" among them) predicts a
Gaussian, with the allowances by which its evidence will be judged. The information that a mixture
of Gaussians holds on its component is bounded from below by

.. math:: I \ge -\sum_k p_k \ln \sum_j p_j e^{-B_{kj}}

B_kj being the Bhattacharyya distance of two components (Kolchinsky & Tracey 2017, Entropy 19, 361).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..fitting.refit import Fit
from ..selection.classes import EffectClass, merge_sets
from ..selection.explanation import Explanation
from ..selection.posterior import Posterior
from ..selection.prediction import Prediction
from ..settings import (
    DESIGN_EXPLANATIONS,
    DESIGN_TESTS,
    LIKELY,
    MANY_TESTS,
    MIN_TEST_GAIN,
    NOTHING_NEW_FRACTION,
    RELEVANT_PROBABILITY,
    REPLICATE_TOLERANCE,
    ROUNDING,
    SAME_TEST_FRACTION,
    SETTLED_PROBABILITY,
    TIE_TOLERANCE,
)
from ..system import Array, Axis, Points
from .advice import (
    CANNOT_BE_SETTLED,
    NO_GAP,
    NO_GAP_WORTH_A_TEST,
    NOISE_HIDES_IT,
    SETTLED,
    UNLISTED,
    Advice,
    Kind,
    Label,
    NextTest,
)

_NOT_IN_THE_LIBRARY = (
    "look for a cause outside the library, where hmcvt diagnose estimates the largest "
    "gap"
)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A conclusion that further tests may confirm.

    Attributes:
        label: the conclusion.
        explanation: the likeliest explanation with this label.
        probability: of all explanations with this label, and of the twins.
        twins: less probable sets that no test distinguishes from it.
    """

    label: Label
    explanation: Explanation
    probability: float
    twins: tuple[Candidate, ...] = ()


def advise(
    posterior: Posterior, possible: Points, classes: Sequence[EffectClass] = ()
) -> Advice:
    """Choose the next tests, each knowing of those before it.

    Args:
        posterior: over the explanations.
        possible: the tests that can be run, by axis.
        classes: effects that no test distinguishes; no test is chosen to do so.
    """
    candidates = candidates_of(posterior)
    *explaining, no_gap = candidates
    base = posterior.base_only.fit
    advice = Advice(
        channels=tuple(channel.name for channel in base.observed.channels),
        candidates=tuple((item.label.effects, item.probability) for item in explaining),
        no_gap=no_gap.probability,
        axes=base.observed.steered,
        classes=tuple(classes),
    )
    if no_gap.probability >= SETTLED_PROBABILITY:
        return replace(advice, reason=NO_GAP_WORTH_A_TEST)
    leading = explaining[0]
    if leading.probability >= SETTLED_PROBABILITY:
        measure = _NOT_IN_THE_LIBRARY if leading.label.kind is Kind.UNLISTED else None
        return replace(advice, reason=SETTLED, measure=measure)
    candidates = [*with_twins(explaining, classes), no_gap]
    design = _Design.of(candidates, base, possible)
    if design is None:
        measure = "none of the tests can be carried"
        return replace(advice, reason=CANNOT_BE_SETTLED, measure=measure)
    pair = _confused_pair(candidates, design)
    if pair is not None:
        one, other = pair
        measure = _remedy(one, other, classes)
        if measure:
            parted = (str(one.label), str(other.label))
            return replace(
                advice, reason=CANNOT_BE_SETTLED, measure=measure, parted=parted
            )
    tests = design.choose([item.label for item in candidates])
    if not tests:
        return replace(advice, reason=NOISE_HIDES_IT)
    of_one_reading = tests[0].gain / tests[0].repeats
    expected = _tests_expected(design.probabilities.max(), of_one_reading)
    return replace(advice, tests=tests, tests_expected=expected)


def within_range(possible: Points, measured: Points, axes: Sequence[Axis]) -> Points:
    """Return the tests within the range of the readings, of those with the same labels.

    Args:
        possible: tests, by axis.
        measured: operating points of the readings, by axis.
        axes: of both.
    """
    label_names = [axis.name for axis in axes if axis.labels and axis.name in measured]
    set_names = [axis.name for axis in axes if axis.steered]
    count = len(measured[set_names[0]])
    labels = np.zeros((1, count))
    of_tests = np.zeros((1, len(possible[set_names[0]])))
    if label_names:
        labels = np.stack([measured[name] for name in label_names])
        of_tests = np.stack([possible[name] for name in label_names])
    inside = np.zeros(of_tests.shape[1], dtype=bool)
    for label in np.unique(labels, axis=1).T:
        readings = (labels == label[:, None]).all(axis=0)
        tests = (of_tests == label[:, None]).all(axis=0)
        for name in set_names:
            known = measured[name][readings]
            tests &= (possible[name] >= known.min()) & (possible[name] <= known.max())
        inside |= tests
    return {name: values[inside] for name, values in possible.items()}


def _confused_pair(
    candidates: Sequence[Candidate], design: _Design
) -> tuple[Candidate, Candidate] | None:
    """Return the most probable set that tests cannot settle, and the one it is confused with.

    None where such sets have less than half of the probability: tests are worth making then.
    """
    labels = [item.label for item in candidates]
    confused = {}
    for i, j in indistinguishable(
        design.predictions, labels, design.probabilities
    ).items():
        confused[i] = candidates[j]
    for i, item in enumerate(candidates):
        if item.twins:
            confused[i] = item.twins[0]
    if design.probabilities[list(confused)].sum() <= LIKELY:
        return None
    first = min(confused)
    return candidates[first], confused[first]


def with_twins(
    candidates: Sequence[Candidate], classes: Sequence[EffectClass]
) -> list[Candidate]:
    """Merge candidates that differ only by members of a class, most probable first.

    The most probable of them represents them.

    Args:
        candidates: most probable first.
        classes: effects that no test distinguishes.
    """
    listed: dict[tuple[str, ...], Candidate] = {}
    merged = []
    for item in candidates:
        if item.label.kind is Kind.LISTED:
            listed[item.label.effects] = item
        else:
            merged.append(item)
    sets = [(names, item.probability) for names, item in listed.items()]
    for class_set in merge_sets(sets, classes):
        first, *others = (listed[names] for names in class_set.sets)
        merged.append(
            replace(first, probability=class_set.probability, twins=tuple(others))
        )
    return sorted(merged, key=lambda item: -item.probability)


def _remedy(one: Candidate, other: Candidate, classes: Sequence[EffectClass]) -> str:
    """Return the measurements that settle which of two sets is present; empty if none is known.

    Of a class all members are settled, the first to check first.
    """
    differing = set(one.explanation.names) ^ set(other.explanation.names)
    remedies: list[str] = []
    for effect_class in classes:
        if len(differing.intersection(effect_class.members)) > 1:
            remedies += effect_class.remedies
    if remedies:
        return "; or ".join(filter(None, dict.fromkeys(remedies)))
    for effect in (*one.explanation.fit.effects, *other.explanation.fit.effects):
        known = effect.remedy in remedies
        if effect.name in differing and effect.remedy and not known:
            remedies.append(effect.remedy)
    return "; or ".join(remedies)


def _tests_expected(probability: float, gain: float) -> int:
    """Return how many tests of equal gain raise a probability until it is settled."""
    from scipy.special import logit

    missing = logit(SETTLED_PROBABILITY) - logit(probability)
    return math.ceil(np.clip(missing / max(2.0 * gain, ROUNDING), 1.0, MANY_TESTS))


@dataclass(frozen=True, eq=False)
class _Design:
    """Predictions of k candidates at n tests that can be run.

    Attributes:
        axes: of the tests.
        points: values along each axis, n of them.
        predictions: of each candidate; zero where it cannot carry a test.
        probabilities: of each candidate, shape (k,).
        weights: probability of each candidate among those that can carry a test, shape (k, n).
    """

    axes: tuple[Axis, ...]
    points: Points
    predictions: list[Prediction]
    probabilities: Array
    weights: Array

    @classmethod
    def of(
        cls, candidates: Sequence[Candidate], base: Fit, possible: Points
    ) -> _Design | None:
        """Predict the tests that the base and most candidates can carry; None if there is none."""
        probabilities = np.array([item.probability for item in candidates])
        probabilities /= probabilities.sum()
        likeliest = candidates[int(np.argmax(probabilities))].explanation
        at_its_noise = replace(base, noise=likeliest.model.noise)
        tests = at_its_noise.observations_at(possible)
        predictions = [
            item.explanation.prediction_at(tests, with_allowances=True)
            for item in candidates
        ]
        carried = np.stack(
            [np.isfinite(prediction.mean).all(axis=0) for prediction in predictions]
        )
        carried_by_base = carried[-1]
        able = carried_by_base & (probabilities @ carried > LIKELY)
        if not able.any():
            return None
        carried = carried[:, able]
        weights = probabilities[:, None] * carried
        weights /= weights.sum(axis=0)
        return cls(
            tests.axes,
            {name: values[able] for name, values in tests.points.items()},
            [
                _restricted(prediction, able, row)
                for prediction, row in zip(predictions, carried, strict=True)
            ],
            probabilities,
            weights,
        )

    def choose(self, labels: Sequence[Label]) -> tuple[NextTest, ...]:
        """Choose the tests of largest gain one after another, updating after each (greedy).

        A neighbour of a test chosen before that adds no information repeats that test. Tests of
        too little information are left out: a first reading may only prepare that of its repeats.
        """
        predictions = self.predictions
        chosen: dict[int, NextTest] = {}
        for _ in range(DESIGN_TESTS):
            distance = _distances(predictions)
            gains = self._expected_information(distance)
            # The first of those that only rounding distinguishes.
            largest = int(np.argmax(gains >= (1.0 - TIE_TOLERANCE) * gains.max()))
            best = self._repeated(largest, gains, chosen)
            if best in chosen:
                test = chosen[best]
                chosen[best] = replace(
                    test,
                    gain=min(test.gain + float(gains[best]), self.entropy),
                    repeats=test.repeats + 1,
                )
            else:
                pair = self._best_separated(distance[:, :, best], best)
                separates = (str(labels[pair[0]]), str(labels[pair[1]]))
                chosen[best] = self._test(best, separates, float(gains[best]))
            predictions = [item.after_reading(best) for item in predictions]
        tests = [test for test in chosen.values() if test.gain >= MIN_TEST_GAIN]
        return tuple(tests)

    @property
    def entropy(self) -> float:
        """Information that settles which candidate is right [nats]."""
        from scipy.special import entr

        return float(np.sum(entr(self.probabilities)))

    def _repeated(self, best: int, gains: Array, chosen: Iterable[int]) -> int:
        """Return the chosen test to repeat in place of the best one, or the best one.

        Args:
            best: index of the test of largest gain.
            gains: of each test, shape (n,).
            chosen: indices of the tests chosen before.
        """
        for index in chosen:
            does_as_well = gains[index] >= NOTHING_NEW_FRACTION * gains[best]
            if self._are_close(index, best, _reach_of_repeat):
                return index
            if does_as_well and self._are_close(index, best, _reach_of_neighbour):
                return index
        return best

    def _are_close(
        self, one: int, other: int, reach: Callable[[Axis, float], float]
    ) -> bool:
        """Whether two tests lie within a reach along every axis.

        Args:
            one: index of a test.
            other: index of another.
            reach: of an axis, from the range of the tests along it.
        """
        for axis in self.axes:
            row = self.points[axis.name]
            if abs(row[one] - row[other]) > reach(axis, float(np.ptp(row))):
                return False
        return True

    def _expected_information(self, distance: Array) -> Array:
        """Lower bound of the information of each test [nats], shape (n,)."""
        from scipy.special import xlogy

        mixture = np.einsum("jn,kjn->kn", self.weights, np.exp(-distance))
        return np.asarray(-xlogy(self.weights, mixture).sum(axis=0))

    def _best_separated(self, distance: Array, test: int) -> tuple[int, int]:
        """Return the two candidates that a test distinguishes best, by their probabilities."""
        weights = self.weights
        value = weights[:, [test]] * weights[:, test] * (1.0 - np.exp(-distance))
        first, second = np.unravel_index(int(np.argmax(value)), value.shape)
        return int(first), int(second)

    def _test(self, index: int, separates: tuple[str, str], gain: float) -> NextTest:
        point = {}
        setting = {}
        for axis in self.axes:
            value = float(self.points[axis.name][index])
            if axis.steered:
                point[axis.name] = value
            if axis.labels:
                setting[axis.name] = axis.labels[int(value)]
        return NextTest(point, separates, gain, setting=setting)


def _reach_of_repeat(axis: Axis, extent: float) -> float:
    """Return the difference along an axis up to which a bench cannot set two tests apart."""
    return max(axis.tolerance, REPLICATE_TOLERANCE * extent)


def _reach_of_neighbour(axis: Axis, extent: float) -> float:
    """Return the difference along an axis up to which tests are neighbours; none of labels."""
    if axis.labels:
        return 0.0
    return SAME_TEST_FRACTION * extent + axis.tolerance


def _restricted(
    prediction: Prediction, able: NDArray[np.bool_], carried: NDArray[np.bool_]
) -> Prediction:
    """Keep some tests of a prediction; tests that its explanation cannot carry become zero."""
    mean = np.where(carried, prediction.mean[:, able], 0.0)
    columns = np.where(carried[:, None], prediction.columns[:, able], 0.0)
    return prediction._replace(mean=mean, columns=columns)


def indistinguishable(
    predictions: Sequence[Prediction], labels: Sequence[Label], probabilities: Array
) -> dict[int, int]:
    """Return the listed sets that many tests would not distinguish from another one.

    Nested sets are skipped: more data always separate them. Unlisted losses are skipped too.

    Args:
        predictions: of each candidate at the possible tests.
        labels: of each candidate.
        probabilities: of each candidate, most probable first, shape (k,).

    Returns:
        For the index of each such set that of the most probable set it is confused with.
    """
    from scipy.special import logit

    listed = [i for i, label in enumerate(labels) if label.kind is Kind.LISTED]
    settled = logit(SETTLED_PROBABILITY)
    confused: dict[int, int] = {}
    for one, other in itertools.combinations(listed, 2):
        effects = set(labels[one].effects)
        other_effects = set(labels[other].effects)
        if effects < other_effects or other_effects < effects:
            continue
        distance = max(
            predictions[one].squared_distance(predictions[other], MANY_TESTS),
            predictions[other].squared_distance(predictions[one], MANY_TESTS),
        )
        log_odds = math.log(probabilities[one] / probabilities[other])
        if distance < 2.0 * (settled - log_odds):
            confused.setdefault(one, other)
        if distance < 2.0 * (settled + log_odds):
            confused.setdefault(other, one)
    return confused


def candidates_of(posterior: Posterior) -> list[Candidate]:
    """Return the conclusions that are still possible, most probable first; no gap comes last.

    A set is represented by an explanation without an unlisted loss, if there is one; an unlisted
    loss by one that has it.
    """
    gathered: dict[Label, Candidate] = {}
    with_gap = 1.0 - posterior.no_gap
    for explanation, probability in posterior.entries:
        fraction = explanation.explained_fraction(posterior.base_only)
        rest = NO_GAP if explanation.is_base_discrepancy else UNLISTED
        listed = Label(Kind.LISTED, explanation.names)
        for label, of_label in ((listed, fraction), (rest, 1.0 - fraction)):
            if of_label:
                total = with_gap * of_label * probability
                _gather(gathered, label, explanation, total)
    base_off = gathered.pop(NO_GAP, None)
    ranked = sorted(gathered.values(), key=lambda item: -item.probability)
    relevant = [item for item in ranked if item.probability >= RELEVANT_PROBABILITY]
    kept = relevant[:DESIGN_EXPLANATIONS] or ranked[:1]
    return [*kept, _no_gap(posterior, base_off)]


def _gather(
    gathered: dict[Label, Candidate],
    label: Label,
    explanation: Explanation,
    probability: float,
) -> None:
    """Add an explanation to the candidate with its label.

    The first explanation of the kind that fits the label represents it, or the first of all.
    """
    before = gathered.get(label, Candidate(label, explanation, 0.0))
    representative = before.explanation
    if not _fits(representative, label) and _fits(explanation, label):
        representative = explanation
    gathered[label] = Candidate(label, representative, before.probability + probability)


def _fits(explanation: Explanation, label: Label) -> bool:
    """Whether an explanation has an unlisted loss or none, as its label has."""
    return explanation.is_listed_set == (label.kind is Kind.LISTED)


def _no_gap(posterior: Posterior, base_off: Candidate | None) -> Candidate:
    """Return no gap: an exact base model, or one that is a little off if that is likelier."""
    if base_off is None:
        return Candidate(NO_GAP, posterior.base_only, posterior.no_gap + 0.0)
    explanation = posterior.base_only
    if base_off.probability > posterior.no_gap:
        explanation = base_off.explanation
    return Candidate(NO_GAP, explanation, posterior.no_gap + base_off.probability)


def _distances(predictions: Sequence[Prediction]) -> Array:
    """Return Bhattacharyya distances of k predictions at each test, shape (k, k, n)."""
    mean = np.stack([prediction.mean.T for prediction in predictions])
    channels = mean.shape[-1]
    variance = np.stack(
        [prediction.reading_covariance for prediction in predictions]
    ) + np.eye(channels)
    log_determinant = np.linalg.slogdet(variance)[1]
    pooled = (variance[:, None] + variance) / 2.0
    difference = mean[:, None] - mean
    solved = np.linalg.solve(pooled, difference[..., None])[..., 0]
    squared = np.einsum("kjnc,kjnc->kjn", difference, solved)
    log_ratio = (
        np.linalg.slogdet(pooled)[1]
        - (log_determinant[:, None] + log_determinant) / 2.0
    )
    return np.asarray(squared / 8.0 + log_ratio / 2.0)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What to measure next, as values and in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from ...files import preformatted
from ..selection.classes import EffectClass, merge_sets, with_probabilities
from ..selection.search import Names
from ..settings import MIN_TEST_GAIN
from ..system import Axis
from ..wording import listed, plain, probability, wrapped

NO_GAP_WORTH_A_TEST = "no gap worth a test"
SETTLED = "settled"
CANNOT_BE_SETTLED = "cannot be settled by tests"
NOISE_HIDES_IT = "no test tells more than the noise"


class Kind(Enum):
    """What an explanation blames for the gap."""

    LISTED = "listed effects"
    UNLISTED = "an unlisted loss"
    NO_GAP = "nothing, or a base model that is a little off"


@dataclass(frozen=True)
class Label:
    """The conclusion that an explanation stands for.

    Attributes:
        kind: what is blamed.
        effects: names, sorted; empty but for listed effects.
    """

    kind: Kind
    effects: Names = ()

    def __str__(self) -> str:
        if self.kind is Kind.NO_GAP:
            return "no gap"
        return named(self.effects)


NO_GAP = Label(Kind.NO_GAP)
UNLISTED = Label(Kind.UNLISTED)


def named(effects: Names) -> str:
    """Return a set of effects in words; the empty set is an unlisted loss."""
    return " + ".join(effects).replace("_", " ") or "something unlisted"


@dataclass(frozen=True)
class NextTest:
    """A test worth making.

    Attributes:
        point: values by the name of the axis; None when no operating point helps.
        separates: the two explanations that it distinguishes best, in words.
        gain: information expected of its readings on which explanation is correct [nats]. Of a
            measurement outside the plan that of distinguishing the two for sure.
        measure: a calibration or measurement outside the plan, or None.
        setting: label along each axis that has labels.
        repeats: how many readings to take at this point.
    """

    point: Mapping[str, float] | None
    separates: tuple[str, str]
    gain: float
    measure: str | None = None
    setting: Mapping[str, str] = field(default_factory=dict)
    repeats: int = 1


@dataclass(frozen=True)
class Advice:
    """What to measure next.

    Attributes:
        reason: to stop, `settled`, `cannot be settled by tests`, `no test tells more than the
            noise` or `no gap worth a test`; None where a further test is worth making.
        tests: the next one, and what may be made along with it, no two alike; empty where none
            helps.
        measure: what settles it where no test can, or None.
        parted: the two explanations that `measure` distinguishes, in words; None for the likeliest.
        tests_expected: how many more, by the first; 0 where no test helps.
        channels: to be read at that point.
        candidates: effects and probability of each explanation that is still possible, best first;
            the entry without a name is an unlisted loss.
        no_gap: probability that there is none, or none larger than a base that is a little off.
        axes: of the tests.
        classes: effects that no test distinguishes.
        notes: on the campaign; why the readings may be of another machine goes first.
        seed: of every random number.
    """

    reason: str | None = None
    tests: tuple[NextTest, ...] = ()
    measure: str | None = None
    parted: tuple[str, str] | None = None
    tests_expected: int = 0
    channels: tuple[str, ...] = ()
    candidates: tuple[tuple[Names, float], ...] = ()
    no_gap: float = 0.0
    axes: tuple[Axis, ...] = ()
    classes: tuple[EffectClass, ...] = ()
    notes: tuple[str, ...] = ()
    seed: int = 0

    @property
    def alive(self) -> tuple[tuple[Names, float], ...]:
        """Earlier name of `candidates`."""
        return self.candidates

    @property
    def stop(self) -> bool:
        """Whether no further test is worth making."""
        return self.reason is not None

    @property
    def next_tests(self) -> tuple[NextTest, ...]:
        """The tests, and the measurement that settles it where no test does."""
        if self.measure is None or len(self.candidates) < 2:
            return self.tests
        (first, _), (second, _), *_ = self.candidates
        separates = self.parted or (named(first), named(second))
        shares = {named(names): share for names, share in self.candidates}
        gain = _information_of_two(*(shares.get(name, 0.0) for name in separates))
        if gain < MIN_TEST_GAIN:
            return self.tests
        return (*self.tests, NextTest(None, separates, gain, self.measure))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt next --json`."""
        test = None
        if self.tests and not self.stop:
            first = self.tests[0]
            test = {
                **(first.point or {}),
                "stage": None,
                **first.setting,
                "repeats": first.repeats,
                "channels": list(self.channels),
            }
        return {
            "stop": self.stop,
            "reason": self.reason,
            "test": test,
            "measure": self.measure,
            "alive": [
                {"effects": list(names), "probability": p}
                for names, p in self.candidates
            ],
            "no_gap_probability": self.no_gap,
            "tests_expected": self.tests_expected,
            "notes": list(self.notes),
        }

    def report(self) -> str:
        """Return which test to run next, or why to stop, as text for a person."""
        lines = [*self.steps(), self._candidates_line()]
        return "\n".join(wrapped(line) for line in lines)

    def steps(self) -> list[str]:
        """Return notes and what to do next, one sentence an entry without line breaks."""
        lines = [f"note: {note}" for note in self.notes]
        if self.stop:
            lines.append(f"stop: {self.reason}")
        else:
            lines += [
                f"next test: {test_in_words(self.tests[0], self.axes)}; "
                f"read {listed(list(map(plain, self.channels)), 'and')}",
                f"about {self.tests_expected} more tests until it is settled",
            ]
        if self.measure is not None:
            apart = ""
            if self.parted:
                apart = ": distinguishes {} from {}".format(*self.parted)
            lines.append(f"measure: {self.measure}{apart}")
        return lines

    def _candidates_line(self) -> str:
        candidates = merge_sets(self.candidates, self.classes)
        in_words = with_probabilities(candidates, "{0} ({1})")
        return (
            f"candidates: {', '.join(in_words)}, no gap or a base model slightly off "
            f"({probability(self.no_gap)})"
        )

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def _information_of_two(one: float, other: float) -> float:
    """Return the information that distinguishes two conclusions for sure [nats].

    Args:
        one: probability of the first.
        other: probability of the second.
    """
    both = one + other
    if min(one, other) <= 0.0:
        return 0.0
    return -one * math.log(one / both) - other * math.log(other / both)


def test_in_words(test: NextTest, axes: Sequence[Axis]) -> str:
    """Return the operating point of a test and how often to read it."""
    words = point_in_words(test, axes)
    return words if test.repeats == 1 else f"{words}, {test.repeats} times"


def point_in_words(test: NextTest, axes: Sequence[Axis]) -> str:
    """Return the operating point of a test."""
    point = test.point or {}
    parts = []
    for axis in axes:
        value = point[axis.name]
        parts.append(axis.test_format.format(value, axis.second_unit_factor * value))
    parts += [f"{name} {label}" for name, label in test.setting.items()]
    return ", ".join(parts)

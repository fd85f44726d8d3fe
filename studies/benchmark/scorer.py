# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Score answers against the truth; imports nothing of hmcvt.

    python -m studies.benchmark.scorer FOLDER [METHOD ...]

FOLDER holds `cases`, `truth` and `answers/METHOD/CASE.json`; prints the table of the methods.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from studies.benchmark.answer import Answer, read_answer
from studies.benchmark.case import RIG, Case, FloatArray, effects, read_columns
from studies.page import table

WORSE = 1.02
"""Error against that of the base from which a prediction counts as worse."""
WITHIN = 1.96
"""Deviations of an interval of 95 %."""


@dataclass(frozen=True)
class Score:
    """One answer against the truth.

    Attributes:
        case: name of the case.
        kind: of what is hidden: `single`, `pair`, `triple`, `newly_listed`, `nothing`, `base_off`,
            `unlisted` or `wrong_sign`.
        verdict: of the answer.
        truth: the right verdict.
        leading: effects of the leading set.
        exact: the leading set is the hidden one.
        same_class: it is, where effects that no test distinguishes count as one.
        part: the part is one in which a hidden effect acts.
        brier: sum over no gap, something unlisted and each set of (probability - truth)^2; 0 to 2.
        removed: 1 - squared error of the prediction / that of the base, at the points.
        worse: the error of the prediction is more than 2 % above that of the base.
        promised: what the answer promised to remove.
        f1: F1 of the points whose gap is above its root mean square.
        coverage: fraction of points whose true gap is within 1.96 deviations of the reported one.
        gap: root mean square of the true gap at the points [-].
        seconds: processor time [s].
    """

    case: str
    kind: str
    verdict: str
    truth: str
    leading: tuple[str, ...]
    exact: bool
    same_class: bool
    part: bool
    brier: float
    removed: float
    worse: bool
    promised: float | None
    f1: float
    coverage: float
    gap: float
    seconds: float


def score(
    case: Case, truth: dict[str, Any], efficiency: FloatArray, given: Answer
) -> Score:
    """Score an answer; points at which the base has no answer (0) do not count.

    Args:
        case: that was answered.
        truth: content of its truth file.
        efficiency: true efficiency at the points, shape (n,).
        given: the answer.
    """
    counted = case.model_at_points.base > 0.0
    base = case.model_at_points.base[counted]
    efficiency = efficiency[counted]
    prediction = np.array(given.prediction)[counted]
    gap = np.array(given.gap)[counted]
    deviation = np.array(given.gap_deviation)[counted]
    true_gap = efficiency - base
    error = np.sqrt(np.mean((prediction - efficiency) ** 2))
    error_of_base = np.sqrt(np.mean(true_gap**2))
    leading = given.sets[0][0] if given.sets else ()
    names = {name.partition(":")[0] for name in leading}
    classes = classes_of(leading, case.card["classes"])
    named = given.verdict == "listed" == truth["verdict"]
    right_parts = {
        part for name in truth["effects"] for part in effects()[name]["part"]
    }
    off = np.abs(gap - true_gap)
    return Score(
        case=case.name,
        kind=truth["kind"],
        verdict=given.verdict,
        truth=truth["verdict"],
        leading=leading,
        exact=named and names == set(truth["effects"]),
        same_class=named and classes == frozenset(truth["classes"]),
        part=given.verdict != "no_gap" and given.part in right_parts,
        brier=brier(given, truth, case.card["classes"]),
        removed=float(1.0 - (error / error_of_base) ** 2),
        worse=bool(error > WORSE * error_of_base),
        promised=given.promised,
        f1=f1(gap, true_gap),
        coverage=float(np.mean(off <= WITHIN * deviation)),
        gap=float(error_of_base),
        seconds=given.seconds,
    )


def classes_of(names: Sequence[str], classes: dict[str, list[str]]) -> frozenset[str]:
    """Return the classes of effects; a name that no class of the card has is its own class."""
    found = set()
    for name in names:
        plain = name.partition(":")[0]
        own = [key for key, members in classes.items() if {plain, name} & set(members)]
        found.add(own[0] if own else plain)
    return frozenset(found)


def brier(given: Answer, truth: dict[str, Any], classes: dict[str, list[str]]) -> float:
    """Return the Brier score over no gap, something unlisted and every set of classes."""
    probabilities: dict[Any, float] = {
        "no_gap": given.no_gap_probability,
        "unlisted": given.unlisted_probability,
    }
    for names, probability in given.sets:
        key = classes_of(names, classes)
        probabilities[key] = probabilities.get(key, 0.0) + probability
    right: Any = truth["verdict"]
    if right == "listed":
        right = frozenset(truth["classes"])
    probabilities.setdefault(right, 0.0)
    return float(sum((p - (key == right)) ** 2 for key, p in probabilities.items()))


def f1(reported: FloatArray, true_gap: FloatArray) -> float:
    """Return F1 of the points above the root mean square of each gap."""
    much = np.abs(true_gap) > np.sqrt(np.mean(true_gap**2))
    size = np.sqrt(np.mean(reported**2))
    where = np.abs(reported) > size if size > 0.0 else np.zeros(len(much), bool)
    both = np.sum(much & where)
    return float(2.0 * both / max(1, np.sum(much) + np.sum(where)))


def answered_methods(folder: Path) -> list[str]:
    """Return the names of the methods that have a folder of answers, sorted."""
    answers = (folder / "answers").glob("*")
    return sorted(path.name for path in answers if path.is_dir())


def scores_of(folder: Path, method: str) -> list[Score]:
    """Return the scores of a method over the cases that have a truth.

    Raises:
        ValueError: there are no cases, or an answer is missing or is none; the file is named.
    """
    truths = sorted((folder / "truth").glob("*.yaml"))
    if not truths:
        raise ValueError(f"{folder / 'truth'}: has no cases")
    answers = folder / "answers" / method
    if not answers.is_dir():
        others = ", ".join(answered_methods(folder)) or "no method"
        raise ValueError(f"{answers}: is no folder; there are answers of {others}")
    missing = [
        path.stem for path in truths if not (answers / f"{path.stem}.json").is_file()
    ]
    if missing:
        raise ValueError(
            f"{answers / missing[0]}.json: is missing; every case needs an answer, "
            f"{len(missing)} of {len(truths)} have none"
        )
    scores = []
    for path in truths:
        case = Case(folder / "cases" / path.stem)
        truth = yaml.safe_load(path.read_text(encoding="utf-8"))
        efficiency = read_columns(path.with_suffix(".csv"))["efficiency"]
        given = read_answer(answers / f"{path.stem}.json", case)
        scores.append(score(case, truth, efficiency, given))
    return scores


def split(
    scores: dict[str, list[Score]],
) -> tuple[dict[str, list[Score]], dict[str, list[Score]]]:
    """Return the scores of simulated cases by method, and those of measured ones."""
    simulated: dict[str, list[Score]] = {}
    measured: dict[str, list[Score]] = {}
    for method, own in scores.items():
        simulated[method] = [each for each in own if not each.case.startswith(RIG)]
        measured[method] = [each for each in own if each.case.startswith(RIG)]
    return simulated, measured


# --- tables -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Attributes:
        what: is measured.
        of: which answers count.
        ask: value of one answer; None where it does not count.
        middle: median instead of share or mean.
        is_share: whether values are yes or no.
        goal: best value.
    """

    what: str
    of: Callable[[Score], bool]
    ask: Callable[[Score], Any]
    middle: bool = False
    is_share: bool = True
    goal: float = 1.0

    def values(self, scores: Sequence[Score]) -> list[Any]:
        """Return the values that count."""
        values = [self.ask(each) for each in scores if self.of(each)]
        return [value for value in values if value is not None]

    def distance(self, scores: Sequence[Score]) -> float:
        """Return how far the figure of one method is from the best value."""
        values = self.values(scores)
        if not values:
            return float("inf")
        return abs(
            float(np.median(values) if self.middle else np.mean(values)) - self.goal
        )

    def cell(self, scores: Sequence[Score]) -> str:
        """Return the figure of one method."""
        values = self.values(scores)
        if not values:
            return "-"
        if self.is_share:
            return f"{sum(values)} of {len(values)}"
        return f"{np.median(values) if self.middle else np.mean(values):.2f}"


def _listed(score: Score) -> bool:
    return score.truth == "listed"


def _single(score: Score) -> bool:
    return score.kind in ("single", "newly_listed")


def _several(score: Score) -> bool:
    return score.kind in ("pair", "triple")


def _unlisted(score: Score) -> bool:
    return score.truth == "unlisted"


def _nothing(score: Score) -> bool:
    return score.kind == "nothing"


def _gap(score: Score) -> bool:
    return score.truth != "no_gap"


def _every(score: Score) -> bool:
    return True


def _miss(score: Score) -> float | None:
    return None if score.promised is None else abs(score.promised - score.removed)


_FAILURES: tuple[tuple[str, Callable[[Score], bool], Callable[[Score], Any]], ...] = (
    (
        "one cause: another effect is named",
        _single,
        lambda s: s.verdict == "listed" and not s.same_class,
    ),
    (
        "two or three causes: another set is named",
        _several,
        lambda s: s.verdict == "listed" and not s.same_class,
    ),
    ("nothing hidden: false alarm", _nothing, lambda s: s.verdict != "no_gap"),
    (
        "base form off, nothing hidden: an effect is named",
        lambda s: s.kind == "base_off",
        lambda s: s.verdict == "listed",
    ),
    (
        "unlisted or wrong sign: a listed effect is named",
        _unlisted,
        lambda s: s.verdict == "listed",
    ),
    ("listed cause refused as unlisted", _listed, lambda s: s.verdict == "unlisted"),
    ("listed cause missed (`no_gap`)", _listed, lambda s: s.verdict == "no_gap"),
    ("prediction worse than the base by over 2 %", _every, lambda s: s.worse),
)
FAILURES = tuple(Figure(*row, goal=0.0) for row in _FAILURES)
SUCCESSES = (
    Figure("one cause: exact", _single, lambda s: s.exact),
    Figure("one cause: exact or its class", _single, lambda s: s.same_class),
    Figure("two or three causes: exact", _several, lambda s: s.exact),
    Figure(
        "two or three causes: exact or their classes", _several, lambda s: s.same_class
    ),
    Figure("machine part right", _listed, lambda s: s.part),
    Figure(
        "unlisted or wrong sign: refused",
        _unlisted,
        lambda s: s.verdict == "unlisted",
    ),
    Figure("nothing hidden: no gap", _nothing, lambda s: s.verdict == "no_gap"),
    Figure(
        "Brier score of the probabilities, mean (0 best, 2 worst)",
        _every,
        lambda s: s.brier,
        is_share=False,
        goal=0.0,
    ),
    Figure(
        "listed: fraction of the squared gap removed, median",
        _listed,
        lambda s: s.removed,
        middle=True,
        is_share=False,
    ),
    Figure(
        "unlisted: fraction of the squared gap removed, median",
        _unlisted,
        lambda s: s.removed,
        middle=True,
        is_share=False,
    ),
    Figure(
        "promised - removed, median size",
        _gap,
        _miss,
        middle=True,
        is_share=False,
        goal=0.0,
    ),
    Figure("where: F1, mean", _gap, lambda s: s.f1, is_share=False),
    Figure(
        "true gap within the interval of 95 %, mean fraction of points",
        _every,
        lambda s: s.coverage,
        is_share=False,
        goal=0.95,
    ),
    Figure(
        "seconds of processor time, median",
        _every,
        lambda s: s.seconds,
        middle=True,
        is_share=False,
        goal=0.0,
    ),
)


def figures_table(scores: dict[str, list[Score]], figures: Sequence[Figure]) -> str:
    """Return a table in Markdown: figures by row, methods by column."""
    rows = [
        (figure.what, *(figure.cell(own) for own in scores.values()))
        for figure in figures
    ]
    return table(("", *scores), rows)


def main() -> None:
    """Print the table of some methods, or write all scores as JSON."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.benchmark.scorer", description="Score answers."
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("methods", nargs="*", help="names of folders; default: all")
    parser.add_argument("--json", action="store_true", help="every score, as JSON")
    options = parser.parse_args()
    methods = options.methods or answered_methods(options.folder)
    if not methods:
        parser.exit(2, f"error: {options.folder / 'answers'}: has no answers\n")
    try:
        scores = {method: scores_of(options.folder, method) for method in methods}
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")
    if options.json:
        plain = {name: [asdict(each) for each in own] for name, own in scores.items()}
        print(json.dumps(plain, indent=1))
        return
    # Apart, as on the page, so that the figures can be compared with it.
    for title, part in zip(("Simulated", "Measured"), split(scores), strict=True):
        count = len(part[methods[0]])
        if count:
            print(f"{title} cases: {count}", end="\n\n")
            print(figures_table(part, FAILURES), end="\n\n")
            print(figures_table(part, SUCCESSES), end="\n\n")


if __name__ == "__main__":
    main()

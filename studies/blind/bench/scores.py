# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Scores of the campaigns on the bench, by classes, with binomial intervals.

Counted strictly: a case that is refused is not first, and a set is right only if its classes are
those hidden, no more and no less.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import binomtest

from studies.blind.bench.truth import SETS
from studies.page import table

Record = dict[str, Any]
#: Squared deviations within which one effect imitates another.
DETECTABLE = 18.0
#: Ratio of errors at fresh tests from which a model is worse than another.
WORSE = 1.02
_BANDS = (0.0, 0.5, 0.7, 0.9, 0.98, 1.01)
_LISTED = tuple(SETS)


# --- questions to one record ------------------------------------------------------------------


def named(record: Record) -> bool:
    """Whether the verdict names a cause."""
    return record["verdict"] in ("cause_found", "class_found", "ambiguous")


def alarmed(record: Record) -> bool:
    """Whether the verdict is that there is a gap."""
    return bool(record["verdict"] != "no_gap")


def refused(record: Record) -> bool:
    """Whether the verdict is that no listed effect, or none in a listed form, explains the gap."""
    return record["verdict"] in ("unexplained", "other_form", "excess_scatter")


def other_form_of_hidden(record: Record) -> bool:
    """Whether the hidden set leads, and the verdict is that its form is not in the list."""
    return record["verdict"] == "other_form" and among(record, 1)


def among(record: Record, best: int) -> bool:
    """Whether the classes hidden are among the best sets."""
    return any(
        classes == record["true_classes"] for classes, _ in record["classes"][:best]
    )


def first_set(record: Record) -> list[str]:
    """Classes of the leading set; empty where there is none."""
    return record["classes"][0][0] if record["classes"] else []


def exact_first(record: Record) -> bool:
    """Whether the leading set is exactly the one hidden."""
    return named(record) and among(record, 1)


def class_first(record: Record) -> bool:
    """Whether the class hidden is in the leading set."""
    if not named(record) or not record["classes"]:
        return False
    return set(record["true_classes"]) <= set(first_set(record))


def false_member(record: Record) -> bool:
    """Whether a class that is not hidden is in the leading set."""
    if not named(record):
        return False
    return bool(set(first_set(record)) - set(record["true_classes"]))


def among_three(record: Record) -> bool:
    """Whether the classes hidden are among three sets that a verdict names."""
    return named(record) and among(record, 3)


def distinguishable(record: Record) -> bool:
    """Whether no effect of another class imitates what is hidden."""
    return record["beyond"] is not None and record["beyond"] >= DETECTABLE


def promise_miss(record: Record) -> float | None:
    """Difference between the removal promised and that at fresh tests."""
    if not named(record) or record["promised"] is None:
        return None
    return float(abs(record["promised"] - record["met"]))


def removed(record: Record) -> float:
    """Fraction of the squared gap that the saved model removes at fresh tests."""
    return float(record["met"])


def not_worse(record: Record) -> bool:
    """Whether the saved model is not worse than the base by more than 2 %."""
    return bool(record["left_gap"] <= WORSE * record["true_gap"])


def not_worse_beyond_meters(record: Record) -> bool | None:
    """Whether `not_worse`, of gaps above twice what meters leave of the level."""
    if record["true_gap"] <= 2.0 * record["level"]:
        return None
    return not_worse(record)


def interval_holds(record: Record) -> bool | None:
    """Whether the interval of the removal holds that at fresh tests."""
    if not named(record) or record["interval"] is None:
        return None
    low, high = record["interval"]
    return bool(low <= record["met"] <= high)


# --- lines of the table -----------------------------------------------------------------------


@dataclass(frozen=True)
class Share:
    """A line that counts records.

    Attributes:
        what: words of the line.
        goal: of the line.
        kinds: of campaign that count.
        holds: asked of each record; None is not counted.
        alone: whether records that something else imitates are left out in a second figure.
    """

    what: str
    goal: str
    kinds: tuple[str, ...]
    holds: Callable[[Record], bool | None]
    alone: bool = True

    def cells(self, records: Sequence[Record]) -> tuple[str, str, str, str]:
        """Return words, goal, figure, and the figure where nothing imitates."""
        chosen = [record for record in records if record["kind"] in self.kinds]
        answers = _answers(chosen, self.holds)
        distinct = ""
        if self.alone:
            only = [record for record in chosen if distinguishable(record)]
            distinct = share(_answers(only, self.holds))
        return self.what, self.goal, share(answers), distinct


@dataclass(frozen=True)
class Figure:
    """A line that sums values up; the words and goal are those of the table."""

    what: str
    goal: str
    kinds: tuple[str, ...]
    value: Callable[[Record], float | None]
    sum_up: Callable[[list[float]], float]

    def cells(self, records: Sequence[Record]) -> tuple[str, str, str, str]:
        """Return words, goal, figure, and nothing."""
        values = []
        for record in records:
            if record["kind"] in self.kinds:
                value = self.value(record)
                if value is not None:
                    values.append(value)
        figure = f"{self.sum_up(values):.2f} of {len(values)}" if values else ""
        return self.what, self.goal, figure, ""


def _answers(
    records: Sequence[Record], holds: Callable[[Record], bool | None]
) -> list[bool]:
    answers = []
    for record in records:
        answer = holds(record)
        if answer is not None:
            answers.append(answer)
    return answers


def share(answers: Sequence[bool]) -> str:
    """Return a share with its 95 % Wilson interval; empty without answers."""
    total = len(answers)
    if total == 0:
        return ""
    hits = sum(answers)
    low, high = binomtest(hits, total).proportion_ci(method="wilson")
    percent = f"{100.0 * hits / total:.0f} % ({100.0 * low:.0f} to {100.0 * high:.0f})"
    return f"{hits}/{total} = {percent}"


def _ninetieth(values: list[float]) -> float:
    return float(np.quantile(values, 0.9))


def _median(values: list[float]) -> float:
    return float(np.median(values))


_EVERY = (*_LISTED, "newly_listed", "nothing", "base_off", "unlisted", "wrong_sign")
LINES: tuple[Share | Figure, ...] = (
    Share("alarms, exact base", "at most 5 %", ("nothing",), alarmed, alone=False),
    Share("cause named, base off", "at most 5 %", ("base_off",), named, alone=False),
    Share("single: class first", "at least 92 %", ("single",), class_first),
    Share("single: exact set first", "at least 85 %", ("single",), exact_first),
    Share("single: a false member leads", "at most 15 %", ("single",), false_member),
    Share("pair: exact set first", "at least 60 %", ("pair",), exact_first),
    Share("pair: among three", "at least 85 %", ("pair",), among_three),
    Share("pair: a false member leads", "at most 15 %", ("pair",), false_member),
    Share("triple: exact set first", "", ("triple",), exact_first),
    Share("triple: among three", "", ("triple",), among_three),
    Share("triple: a false member leads", "", ("triple",), false_member),
    Share("unlisted refused", "at least 80 %", ("unlisted",), refused),
    Share("newly listed: exact set first", "", ("newly_listed",), exact_first),
    Share("newly listed: among three", "", ("newly_listed",), among_three),
    Share("wrong sign refused", "", ("wrong_sign",), refused),
    Share("listed refused", "at most 5 %", _LISTED, refused),
    Share(
        "counted as refused: the hidden set, said to have another form",
        "",
        _LISTED,
        other_form_of_hidden,
    ),
    Figure("promised - met: median", "at most 0.05", _LISTED, promise_miss, _median),
    Figure(
        "promised - met: 90th percentile",
        "at most 0.2",
        _LISTED,
        promise_miss,
        _ninetieth,
    ),
    Figure(
        "unlisted, wrong sign: part removed by what is served, median",
        "at least 0.7",
        ("unlisted", "wrong_sign"),
        removed,
        _median,
    ),
    Share("served: not worse than the base", "at least 97 %", _EVERY, not_worse, False),
    Share(
        "the same, gap above twice the level of the meters",
        "at least 97 %",
        _EVERY,
        not_worse_beyond_meters,
        False,
    ),
    Share(
        "interval of the promise holds", "90 to 98 %", _LISTED, interval_holds, False
    ),
    Figure(
        "`gap_at`: median correlation with the true field",
        "at least 0.95",
        _LISTED,
        lambda record: float(record["correlation"]),
        _median,
    ),
    Figure(
        "seconds of a diagnosis: median",
        "",
        _EVERY,
        lambda record: float(record["seconds"]),
        _median,
    ),
    Figure(
        "seconds of a diagnosis: largest",
        "at most 5",
        _EVERY,
        lambda record: float(record["seconds"]),
        max,
    ),
)


def score_table(records: Sequence[Record]) -> str:
    """Return every line with goal, figure, and the figure where nothing else imitates."""
    rows = [line.cells(records) for line in LINES]
    head = ("", "goal", "figure", "where no other class imitates")
    return table(head, [row for row in rows if row[2]])


def band_table(records: Sequence[Record]) -> str:
    """Return how often the first set is right in each band of its probability."""
    answers = [_said(record) for record in records if alarmed(record)]
    rows = []
    for low, high in pairwise(_BANDS):
        inside = [(p, right) for p, right in answers if low <= p < high]
        if not inside:
            continue
        mean = np.mean([p for p, _ in inside])
        rows.append(
            (
                f"{low:.2f} to {min(high, 1.0):.2f}",
                f"{mean:.2f}",
                share([right for _, right in inside]),
            )
        )
    return table(("probability of the first set", "mean", "right"), rows)


def member_table(records: Sequence[Record]) -> str:
    """Return how often a member is hidden in each tenth of its inclusion probability."""
    answers = []
    for record in records:
        for classes, probability in record["members"]:
            answers.append(
                (probability, bool(set(classes) & set(record["true_classes"])))
            )
    rows = []
    for low, high in pairwise(np.linspace(0.0, 1.0, 11)):
        inside = [(p, right) for p, right in answers if low < p <= high]
        if inside:
            mean = np.mean([p for p, _ in inside])
            hidden = share([right for _, right in inside])
            rows.append((f"{low:.1f} to {high:.1f}", f"{mean:.2f}", hidden))
    return table(("inclusion probability", "mean", "hidden"), rows)


def unlisted_table(records: Sequence[Record]) -> str:
    """Return what is answered to each loss that the list lacks; empty without such campaigns."""
    by_loss: dict[str, list[Record]] = {}
    for record in records:
        if record["kind"] == "unlisted":
            by_loss.setdefault(record["truth"][0], []).append(record)
    rows = []
    for loss, of_loss in sorted(by_loss.items()):
        instead = Counter(
            " + ".join(first_set(record)) for record in of_loss if named(record)
        )
        rows.append(
            (
                f"`{loss}`",
                len(of_loss),
                sum(refused(record) for record in of_loss),
                sum(not alarmed(record) for record in of_loss),
                sum(not distinguishable(record) for record in of_loss),
                "; ".join(f"{words} ({count})" for words, count in instead.items()),
            )
        )
    head = ("hidden", "campaigns", "refused", "no gap", "imitated", "named instead")
    return table(head, rows) if rows else ""


def _said(record: Record) -> tuple[float, bool]:
    """Probability of the first set, and whether it is right."""
    if not record["classes"]:
        return 0.0, False
    right = among(record, 1) and record["kind"] in (*_LISTED, "newly_listed")
    return float(record["classes"][0][1]), right


def misses(records: Sequence[Record]) -> str:
    """Return a line for each campaign that is not answered as wanted."""
    lines = []
    for record in records:
        if as_wanted(record):
            continue
        sets = "; ".join(
            f"{' + '.join(classes)} {100.0 * p:.0f} %"
            for classes, p in record["classes"][:3]
        )
        left = ", ".join(f"{value:.0f}" for value in record["left"])
        beyond = record["beyond"]
        imitated = "" if beyond is None else f", imitated within {beyond:.0f}"
        lines.append(
            f"{record['kind']}/{record['seed']} {record['layout']} "
            f"{' + '.join(record['truth']) or '-'} (leaves {left or '-'}{imitated}): "
            f"{record['verdict']}: {sets}; unlisted {100.0 * record['unlisted']:.0f} %"
        )
    return "\n".join(lines)


def as_wanted(record: Record) -> bool:
    """Whether a campaign is answered as one wants it."""
    kind = record["kind"]
    if kind == "nothing":
        return not alarmed(record)
    if kind == "base_off":
        return not named(record)
    if kind in ("unlisted", "wrong_sign"):
        return refused(record)
    return exact_first(record)


def cost_table(all_records: Mapping[str, Sequence[Record]]) -> str:
    """Return the main figures of runs with one property switched off, one run a line."""
    chosen = [
        line for line in LINES if line.what in _COST_LINES and isinstance(line, Share)
    ]
    rows = []
    for name, records in all_records.items():
        cells = [line.cells(records)[2] for line in chosen]
        miss = Figure("", "", _LISTED, promise_miss, _median).cells(records)[2]
        rows.append((name, *cells, miss))
    head = ("switched off", *(line.what for line in chosen), "promised - met: median")
    return table(head, rows)


_COST_LINES = (
    "alarms, exact base",
    "cause named, base off",
    "single: exact set first",
    "pair: exact set first",
    "pair: a false member leads",
    "unlisted refused",
    "interval of the promise holds",
)

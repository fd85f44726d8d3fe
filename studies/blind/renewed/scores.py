# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Scores of the campaigns of the renewed plant: the library, and the oracle next to it."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from studies.blind.bench.scores import (
    Record,
    alarmed,
    among_three,
    as_wanted,
    class_first,
    exact_first,
    false_member,
    first_set,
    interval_holds,
    member_table,
    named,
    not_worse,
    other_form_of_hidden,
    promise_miss,
    refused,
    share,
)
from studies.blind.renewed.campaign import SETS
from studies.page import table

#: Squared deviations from which an effect is plainly visible.
VISIBLE = 200.0
_BANDS = (0.0, 0.5, 0.7, 0.9, 1.01)
_LISTED = tuple(SETS)


# --- questions to one record ------------------------------------------------------------------


def drawn(records: Sequence[Record]) -> list[Record]:
    """Return the records of campaigns that could be drawn."""
    return [record for record in records if "error" not in record]


def visible(record: Record) -> bool:
    """Whether every hidden effect leaves more than `VISIBLE` squared deviations."""
    return bool(record["left"]) and min(record["left"]) >= VISIBLE


def answered_accessory(record: Record) -> bool:
    """Whether an accessory is named, or refused where the list has none."""
    if record["true_classes"]:
        return exact_first(record)
    return refused(record)


def oracle_first(record: Record) -> list[str] | None:
    """Classes of the oracle's leading set; None where it is not asked."""
    return record["oracle"][0][0] if "oracle" in record else None


def oracle_exact(record: Record) -> bool | None:
    """Whether the oracle's leading set is exactly the one hidden."""
    first = oracle_first(record)
    return None if first is None else first == record["oracle_classes"]


def oracle_contains(record: Record) -> bool | None:
    """Whether the oracle's leading set has what is hidden."""
    first = oracle_first(record)
    return None if first is None else set(record["oracle_classes"]) <= set(first)


def oracle_false(record: Record) -> bool | None:
    """Whether the oracle's leading set has a member that is not hidden."""
    first = oracle_first(record)
    return None if first is None else bool(set(first) - set(record["oracle_classes"]))


def oracle_among_three(record: Record) -> bool | None:
    """Whether what is hidden is among the oracle's three leading sets."""
    if "oracle" not in record:
        return None
    return any(item[0] == record["oracle_classes"] for item in record["oracle"][:3])


# --- lines of the table -----------------------------------------------------------------------

Question = Callable[[Record], bool | None]


@dataclass(frozen=True)
class Line:
    """A line that counts records.

    Attributes:
        what: words of the line.
        goal: of the line.
        kinds: of campaign that count.
        holds: asked of each record; None is not counted.
        oracle: the same question to the oracle, or None.
        only: which records count.
    """

    what: str
    goal: str
    kinds: tuple[str, ...]
    holds: Question
    oracle: Question | None = None
    only: Callable[[Record], bool] = lambda record: True

    def cells(self, records: Sequence[Record]) -> tuple[str, str, str, str, str]:
        """Return words, goal, library, oracle, and library where the oracle is right."""
        chosen = [r for r in records if r["kind"] in self.kinds and self.only(r)]
        tellable = [record for record in chosen if oracle_exact(record)]
        if self.oracle is None:
            return self.what, self.goal, _share(chosen, self.holds), "", ""
        return (
            self.what,
            self.goal,
            _share(chosen, self.holds),
            _share(chosen, self.oracle),
            _share(tellable, self.holds),
        )


def _share(records: Sequence[Record], holds: Question) -> str:
    answers = [holds(record) for record in records]
    return share([answer for answer in answers if answer is not None])


LINES = (
    Line("exact base: alarms", "at most 5 %", ("nothing",), alarmed, oracle_false),
    Line("exact base: a cause named", "0 %", ("nothing",), named),
    Line("base off: a cause named", "at most 5 %", ("base_off",), named, oracle_false),
    Line(
        "single, visible: in the first set",
        "at least 90 %",
        ("single",),
        class_first,
        oracle_contains,
        visible,
    ),
    Line(
        "single, visible: exact",
        "at least 75 %",
        ("single",),
        exact_first,
        oracle_exact,
        visible,
    ),
    Line(
        "single, visible: a false member leads",
        "at most 10 %",
        ("single",),
        false_member,
        oracle_false,
        visible,
    ),
    Line("single: in the first set", "", ("single",), class_first, oracle_contains),
    Line("single: exact", "", ("single",), exact_first, oracle_exact),
    Line("single: a false member leads", "", ("single",), false_member, oracle_false),
    Line(
        "pair, both visible: exact", "", ("pair",), exact_first, oracle_exact, visible
    ),
    Line(
        "pair, both visible: among three",
        "",
        ("pair",),
        among_three,
        oracle_among_three,
        visible,
    ),
    Line("pair: exact", "at least 60 %", ("pair",), exact_first, oracle_exact),
    Line(
        "pair: among three", "at least 80 %", ("pair",), among_three, oracle_among_three
    ),
    Line("pair: a false member leads", "", ("pair",), false_member, oracle_false),
    Line("triple: exact", "", ("triple",), exact_first, oracle_exact),
    Line("triple: a false member leads", "", ("triple",), false_member, oracle_false),
    Line("unlisted: refused", "at least 85 %", ("unlisted",), refused, oracle_exact),
    Line(
        "accessory: named, or refused where it is not listed",
        "",
        ("accessory",),
        answered_accessory,
        oracle_exact,
    ),
    Line("wrong sign: refused", "at least 85 %", ("wrong_sign",), refused),
    Line("listed: refused", "at most 5 %", _LISTED, refused),
    Line(
        "counted as refused: the hidden set, said to have another form",
        "",
        _LISTED,
        other_form_of_hidden,
    ),
    Line("promise: interval holds", "90 to 98 %", _LISTED, interval_holds),
    Line(
        "saved model: not worse than the base",
        "at least 97 %",
        ("nothing", "base_off", "unlisted", "wrong_sign", "accessory", *_LISTED),
        not_worse,
    ),
)


def score_table(records: Sequence[Record]) -> str:
    """Return every line: goal, library, oracle, and library where the oracle is right."""
    rows = [line.cells(records) for line in LINES]
    head = ("", "goal", "library", "oracle", "library where the oracle is right")
    return table(head, [row for row in rows if row[2]])


def limits_table(
    records: Sequence[Record], runs: Mapping[str, Sequence[Record]]
) -> str:
    """Return what of the misses comes from errors of base and meters, and what the oracle leaves.

    Campaigns that could not be drawn are left out.

    Args:
        records: of a run with all errors.
        runs: records of the same campaigns by the errors that are missing.
    """
    others_drawn = [drawn(run) for run in runs.values()]
    rows = []
    for line in LINES:
        if line.oracle is None:
            continue
        what, goal, library, oracle, _ = line.cells(drawn(records))
        others = [line.cells(other)[2] for other in others_drawn]
        if library:
            rows.append((what, goal, library, *others, oracle))
    heads = [f"library without {name}" for name in runs]
    return table(("", "goal", "library", *heads, "oracle"), rows)


def promise_table(records: Sequence[Record]) -> str:
    """Return quantiles of the promise and of the time of a diagnosis."""
    misses = [promise_miss(r) for r in records if r["kind"] in _LISTED]
    usable = [miss for miss in misses if miss is not None]
    seconds = [float(record["seconds"]) for record in records]
    rows = []
    if usable:
        middle, high = np.quantile(usable, (0.5, 0.9))
        rows.append(("promised - met", f"{middle:.2f}", f"{high:.2f}", len(usable)))
    if seconds:
        middle = float(np.median(seconds))
        rows.append(("seconds", f"{middle:.1f}", f"{max(seconds):.1f}", len(seconds)))
    head = ("", "median", "90th percentile; of seconds the largest", "campaigns")
    return table(head, rows)


def band_table(records: Sequence[Record]) -> str:
    """Return how often the first set is right by its probability, of library and oracle."""
    library = []
    oracle = []
    for record in records:
        if alarmed(record) and record["classes"]:
            right = bool(record["true_classes"]) and (
                first_set(record) == record["true_classes"]
            )
            right = right and record["kind"] not in ("unlisted", "wrong_sign")
            library.append((float(record["classes"][0][1]), right))
        # What has the wrong sign is outside the model of the oracle.
        if "oracle" in record and record["kind"] != "wrong_sign":
            oracle.append((float(record["oracle"][0][1]), bool(oracle_exact(record))))
    rows = []
    for low, high in pairwise(_BANDS):
        cells = []
        for answers in (library, oracle):
            inside = [(p, right) for p, right in answers if low <= p < high]
            mean = np.mean([p for p, _ in inside]) if inside else float("nan")
            cells += [f"{mean:.2f}", share([right for _, right in inside])]
        rows.append((f"{low:.1f} to {min(high, 1.0):.1f}", *cells))
    head = ("probability of the first set", "mean", "library right")
    return table((*head, "mean", "oracle right"), rows)


def false_member_table(records: Sequence[Record]) -> str:
    """Return which false members lead, next to what they stand and on which layout."""
    counts: dict[str, Counter[str]] = {}
    totals: Counter[str] = Counter()
    for record in records:
        if not named(record):
            continue
        for wrong in set(first_set(record)) - set(record["true_classes"]):
            hidden = " + ".join(record["truth"]) or record["kind"]
            where = f"{hidden} on {record['layout']}"
            counts.setdefault(wrong, Counter())[where] += 1
            totals[wrong] += 1
    rows = []
    for wrong, total in totals.most_common():
        cases = [
            f"{where} ({count})" if count > 1 else where
            for where, count in counts[wrong].most_common()
        ]
        rows.append((f"`{wrong}`", total, "; ".join(cases)))
    head = ("false member", "campaigns", "hidden, layout")
    return table(head, rows) if rows else ""


def misses(records: Sequence[Record]) -> str:
    """Return a line for each campaign that is not answered as wanted."""
    lines = []
    for record in records:
        wanted = (
            answered_accessory(record)
            if record["kind"] == "accessory"
            else as_wanted(record)
        )
        if not wanted:
            lines.append(_miss(record))
    return "\n".join(lines)


def _miss(record: Record) -> str:
    """Return one campaign as a line."""
    sets = "; ".join(_said(item) for item in record["classes"][:3])
    left = ", ".join(f"{value:.0f}" for value in record["left"])
    oracle = _said(record["oracle"][0]) if "oracle" in record else "not asked"
    errors = " + ".join(record["base_errors"]) or "exact"
    hidden = []
    for name in record["truth"]:
        variant = record["variants"][name]
        hidden.append(f"{name}:{variant}" if variant else name)
    return (
        f"{record['kind']}/{record['seed']} {record['layout']}, {record['tests']} tests, "
        f"base {errors}: {' + '.join(hidden) or '-'} (leaves {left or '-'}): "
        f"{record['verdict']}: {sets}; unlisted {100.0 * record['unlisted']:.0f} %; "
        f"oracle {oracle}"
    )


def _said(item: Sequence[object]) -> str:
    classes, probability = item
    names = " + ".join(str(name) for name in classes)  # type: ignore[attr-defined]
    return f"{names or 'nothing'} {100.0 * float(str(probability)):.0f} %"


def report(records: Sequence[Record]) -> str:
    """Return the tables of a run."""
    usable = drawn(records)
    parts = [
        score_table(usable),
        promise_table(usable),
        band_table(usable),
        member_table(usable),
        false_member_table(usable),
        misses(usable),
    ]
    for record in records:
        if "error" in record:
            parts.append(f"{record['kind']}/{record['seed']}: {record['error']}")
    return "\n\n".join(part for part in parts if part)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Scores of a blind trial, with Wilson intervals; records in, text out.

Counted strictly: a case that is refused is not first, a set longer than three does not count, a set
is right when it is exactly what was hidden.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from studies.blind.campaign import CampaignOptions
from studies.blind.catalogue import KNOWN_EFFECTS
from studies.blind.conditions import DETECTABLE, LISTED, LOOP, NOISES, STRANGE, STRESS
from studies.blind.loop import MOST
from studies.page import render, table

Record = dict[str, Any]
_ARMS = ("asked", "random")
_BANDS = (0.0, 0.5, 0.7, 0.9, 0.98, 1.01)
_FEWEST = 5  # answers that make a band worth judging
_GONE = 0.85  # of the squared gap
_FITTED = 7  # parameters, with one effect and its shape
_TWINS = ("bearing_drag", "charge_pump", "gear_mesh/efficiency", "torque_sensor")


# --- what is asked of a record ------------------------------------------------------------------


def _named(record: Record) -> bool:
    return record["verdict"] in ("cause_found", "class_found", "ambiguous")


def _alarmed(record: Record) -> bool:
    return bool(record["verdict"] != "no_gap")


def _refused(record: Record) -> bool:
    return record["verdict"] in ("unexplained", "other_form", "excess_scatter")


def _among(record: Record, best: int = 3) -> bool:
    return any(effects == record["truth"] for effects, _ in record["sets"][:best])


def _first(record: Record) -> bool:
    return _named(record) and _among(record, 1)


def _short(record: Record) -> bool:
    """The first cause and what it cannot be told from are at most three, the true one in it."""
    return _named(record) and any(
        len(each) <= 3 and set(record["truth"]) <= set(each)
        for each in record["alternatives"]
    )


def _twinned(record: Record) -> bool:
    return any(
        name in _TWINS or f"{name}/{variant}" in _TWINS
        for name, variant in zip(record["truth"], record["variants"], strict=True)
    )


def _untwinned(record: Record) -> bool | None:
    return None if _twinned(record) else _first(record)


def _gone(record: Record) -> bool | None:
    return record["met"] >= _GONE if _first(record) else None


def _room(record: Record) -> bool:
    """Whether what no fit can remove leaves room: the misfit, and what noise makes of it."""
    noise = _FITTED * NOISES[record["condition"]] ** 2 / CampaignOptions.samples
    return bool(
        noise + record["misfit"] ** 2 <= (1.0 - _GONE) * record["true_gap"] ** 2
    )


def _miss(record: Record) -> float | None:
    promised = record["promised"]
    return (
        abs(promised - record["met"])
        if _named(record) and promised is not None
        else None
    )


# --- questions ----------------------------------------------------------------------------------


class _Question(NamedTuple):
    """One line of the goals: what is asked of the records of some groups; None is no answer.

    `sum_up` makes a figure of the answers; without it, it is their share. `beside`: whether the
    table of parts has it too.
    """

    what: str
    goal: float
    groups: Sequence[str]
    ask: Callable[[Record], Any]
    at_most: bool = False
    sum_up: Callable[[list[Any]], float] | None = None
    beside: bool = False

    def answer(self, records: Sequence[Record]) -> tuple[float | None, str]:
        answers = [
            each
            for r in records
            if r["group"] in self.groups
            if (each := self.ask(r)) is not None
        ]
        if not answers:
            return None, ""
        if self.sum_up is None:
            return float(np.mean(answers)), _share(
                sum(map(bool, answers)), len(answers)
            )
        figure = self.sum_up(answers)
        return figure, f"{figure:.2f}"

    def cell(self, records: Sequence[Record]) -> str:
        figure, text = self.answer(records)
        missed = figure is not None and (
            figure > self.goal if self.at_most else figure < self.goal
        )
        return text + (" **missed**" if missed else "")

    @property
    def aim(self) -> str:
        goal = f"{100 * self.goal:.0f} %" if self.sum_up is None else f"{self.goal:g}"
        return (
            f"{'at most' if self.at_most else 'at least'} {goal}" if self.goal else ""
        )


def _alone(group: str, what: str, ask: Callable[[Record], Any]) -> _Question:
    """The same question where it can be answered."""
    return _Question(
        f"{group}: {what}, where no other listed effect imitates it",
        0.0,
        [group],
        lambda r: ask(r) if r["beyond"] >= DETECTABLE else None,
    )


def _ninetieth(answers: list[float]) -> float:
    return float(np.quantile(answers, 0.9))


def _worst_band(answers: list[tuple[float, bool]]) -> float:
    return max(
        (
            float(abs(np.mean(said) - np.mean(right)))
            for said, right in _bands(answers)
            if len(said) >= _FEWEST
        ),
        default=0.0,
    )


def _bands(
    answers: Sequence[tuple[float, bool]],
) -> list[tuple[list[float], list[bool]]]:
    """Sort probabilities, each with whether it was right, into bands."""
    return [
        (
            [said for said, _ in answers if low <= said < high],
            [right for said, right in answers if low <= said < high],
        )
        for low, high in pairwise(_BANDS)
    ]


def _said(record: Record) -> tuple[float, bool] | None:
    """Probability of the first set, and whether it is right."""
    if not _alarmed(record) or not record["sets"]:
        return None
    return record["sets"][0][1], _among(record, 1) and record["group"] in (
        *LISTED,
        "faint",
    )


_EVERY = (*LISTED, *STRANGE, "none", "base off", "faint")
_QUESTIONS = (
    _Question(
        "single, not confounded: first",
        0.95,
        ["single"],
        _untwinned,
        beside=True,
    ),
    _alone("single", "first", _first),
    _Question(
        "single: in a set of at most three",
        0.95,
        ["single"],
        _short,
        beside=True,
    ),
    _alone("single", "in a set of at most three", _short),
    _Question("pair: exact set first", 0.70, ["pair"], _first, beside=True),
    _alone("pair", "first", _first),
    _Question("pair: among the best three sets", 0.90, ["pair"], _among),
    _Question("triple: exact set first", 0.50, ["triple"], _first),
    _alone("triple", "first", _first),
    _Question("triple: among the best three sets", 0.80, ["triple"], _among),
    _Question(
        "false alarms, exact base",
        0.05,
        ["none"],
        _alarmed,
        at_most=True,
        beside=True,
    ),
    _Question(
        "cause named, base off by 0.1 to 0.2 points",
        0.05,
        ["base off"],
        _named,
        at_most=True,
    ),
    _Question("unlisted refused", 0.85, ["unlisted"], _refused, beside=True),
    _alone("unlisted", "refused", _refused),
    _Question("wrong sign refused", 0.85, ["wrong sign"], _refused),
    _alone("wrong sign", "refused", _refused),
    _Question(
        "location of unlisted and wrong-sign effects found",
        0.80,
        STRANGE,
        lambda r: r["place_found"],
    ),
    _Question("listed refused", 0.05, LISTED, _refused, at_most=True),
    _Question(
        "correctly named: 85 % of the squared gap removed",
        0.85,
        LISTED,
        _gone,
    ),
    _Question(
        "removed, where noise and base permit",
        0.0,
        LISTED,
        lambda r: _gone(r) if _room(r) else None,
    ),
    _Question(
        "reported gap at least half of the true one",
        0.95,
        LISTED,
        lambda r: r["told_gap"] >= 0.5 * r["true_gap"],
    ),
    _Question(
        "where: F1 of the reported regions, listed",
        0.65,
        LISTED,
        lambda r: r["f1"],
        sum_up=np.mean,
    ),
    _Question(
        "where: F1 of naming everything",
        0.0,
        LISTED,
        lambda r: r["f1_everything"],
        sum_up=np.mean,
    ),
    _Question(
        "`gap_at`: median correlation with the true field",
        0.95,
        LISTED,
        lambda r: r["correlation"],
        sum_up=np.median,
    ),
    _Question(
        "promised - met: median",
        0.05,
        LISTED,
        _miss,
        at_most=True,
        sum_up=np.median,
        beside=True,
    ),
    _Question(
        "promised - met: 90th percentile",
        0.15,
        LISTED,
        _miss,
        at_most=True,
        sum_up=_ninetieth,
    ),
    _Question(
        "promised - met: 90th percentile, where they permit",
        0.0,
        LISTED,
        lambda r: _miss(r) if _room(r) else None,
        sum_up=_ninetieth,
    ),
    _Question(
        "probability of the first set: largest error of a band",
        0.10,
        _EVERY,
        _said,
        at_most=True,
        sum_up=_worst_band,
    ),
    _Question(
        "slowest diagnosis [s of processor time]",
        5.0,
        _EVERY,
        lambda r: r["seconds"],
        at_most=True,
        sum_up=max,
    ),
)
_BESIDE = [each for each in _QUESTIONS if each.beside]


# --- tables -------------------------------------------------------------------------------------


def report(records: Sequence[Record], command: str, seeds: str) -> str:
    """Return the whole score as Markdown, with the command that wrote it and what its seeds are."""
    reference = [r for r in records if r["condition"] in NOISES]
    parts = [
        (f"{word} {name}", [r for r in reference if (name in r["columns"]) is there])
        for name in ("output_speed", "oil_temperature", "pressure")
        for word, there in (("with", True), ("without", False))
    ]
    parts += [
        ("base exact", [r for r in reference if not r["misfit"]]),
        ("base off", [r for r in reference if r["misfit"]]),
    ]
    parts += [(name, [r for r in records if r["condition"] == name]) for name in STRESS]
    return render(
        "report.md.j2",
        Path(__file__).parent,
        command=command,
        seeds=seeds,
        detectable=DETECTABLE,
        goals=goals(records) if reference else "",
        loop=_loop([r for r in records if r["condition"] == LOOP]),
        by_effect=_by_effect(reference),
        calibration=_calibration(reference),
        parts=table(
            ("", *(each.what for each in _BESIDE)),
            [
                (name, *(each.answer(own)[1] for each in _BESIDE))
                for name, own in parts
                if own
            ],
        ),
    )


def goals(records: Sequence[Record]) -> str:
    """Return what is to be reached beside what was, at either noise."""
    own = {name: [r for r in records if r["condition"] == name] for name in NOISES}
    own = {name: some for name, some in own.items() if some}
    return table(
        ("", "goal", *(f"noise {name}" for name in own)),
        [(each.what, each.aim, *map(each.cell, own.values())) for each in _QUESTIONS],
    )


def misses(records: Sequence[Record]) -> str:
    """Return a line for each campaign whose answer is not the one wanted."""
    wanted = {
        "none": "no_gap",
        "base off": "no_gap",
        **dict.fromkeys(STRANGE, "unexplained"),
    }
    lines = []
    for r in records:
        right = (
            r["verdict"] == wanted[r["group"]] if r["group"] in wanted else _first(r)
        )
        if not right and r["group"] != "faint":
            sets = "; ".join(
                f"{'+'.join(effects)} {100 * p:.0f} %" for effects, p in r["sets"][:3]
            )
            lines.append(
                f"{r['condition']}/{r['kind']}/{r['seed']} {'+'.join(r['truth'])} "
                f"{[round(each) for each in r['left']]} {' '.join(r['columns'])}: "
                f"{r['verdict']}: {sets}; unlisted {100 * r['unlisted']:.0f} %"
            )
    return "\n".join(lines)


def _share(hits: int, total: int) -> str:
    if total == 0:
        return ""
    low, high = binomtest(hits, total).proportion_ci(method="wilson")
    return f"{hits}/{total} = {100 * hits / total:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def _by_effect(records: Sequence[Record]) -> str:
    rows = []
    for kind in dict.fromkeys(r["kind"] for r in records):
        own = [r for r in records if r["kind"] == kind]
        wrong = Counter(
            "+".join(r["sets"][0][0])
            for r in own
            if _named(r) and r["sets"] and not _among(r, 1)
        )
        rows.append(
            (
                kind,
                len(own),
                *(
                    sum(map(hit, own)) or ""
                    for hit in (
                        _first,
                        _among,
                        _short,
                        _refused,
                        lambda r: not _alarmed(r),
                    )
                ),
                f"{np.mean([r['f1'] for r in own]):.2f}",
                ", ".join(f"{name} ({count})" for name, count in wrong.most_common(3)),
            )
        )
    return table(
        (
            "hidden",
            "campaigns",
            "exact set first",
            "among three sets",
            "in a set of three",
            "refused",
            "no gap reported",
            "F1 of where",
            "named instead",
        ),
        rows,
    )


def _calibration(records: Sequence[Record]) -> str:
    answers = [said for said in map(_said, records) if said is not None]
    return table(
        ("probability of the first set", "mean probability", "right"),
        [
            (
                f"{low:.2f} to {min(high, 1.0):.2f}",
                f"{np.mean(said):.2f}" if said else "",
                _share(sum(right), len(right)),
            )
            for (low, high), (said, right) in zip(
                pairwise(_BANDS), _bands(answers), strict=True
            )
        ],
    )


def _loop(records: Sequence[Record]) -> str:
    """Tests made as asked for against tests at random, and what either ends with."""
    if not records:
        return ""
    # A set that neither run settles tells nothing of how fast they are.
    settling = [r for r in records if r["asked"]["right"] or r["random"]["right"]]
    tests = [
        sum(r[arm]["tests"] if r[arm]["right"] else MOST for r in settling)
        for arm in _ARMS
    ]
    right = [sum(r[arm]["right"] for r in settling) for arm in _ARMS]
    rows: list[tuple[str, ...]] = [
        (
            f"tests until the right set is settled, {MOST} where it is not",
            "",
            *(f"{n / len(settling):.1f}" if settling else "" for n in tests),
        ),
        (
            "the same, at the rate at which they settle",
            "at most a third",
            *(
                f"{n / count:.1f}" if count else ""
                for n, count in zip(tests, right, strict=True)
            ),
        ),
        (
            "slowest advice [s of processor time]",
            "at most 5",
            f"{max(r['seconds'] for r in records):.1f}",
            "",
        ),
    ]
    for what, goal, groups, hit in (
        ("right set settled", "", LISTED, lambda end: end["right"]),
        ("wrong set settled", "at most 5 %", (*LISTED, "none"), _wrong),
        (
            "unlisted or wrong sign: a listed effect settled",
            "at most 10 %",
            STRANGE,
            _wrong,
        ),
        (
            "nothing hidden: advised to stop",
            "",
            ("none",),
            lambda end: end["reason"] and not end["settled"],
        ),
    ):
        own = [r for r in records if r["group"] in groups]
        rows.append(
            (
                what,
                goal,
                *(
                    _share(sum(bool(hit(r[arm])) for r in own), len(own))
                    for arm in _ARMS
                ),
            )
        )
    return table(("", "goal", "as asked", "at random"), rows)


def _wrong(end: dict[str, Any]) -> bool:
    return bool(
        end["settled"]
        and not end["right"]
        and set(end["alive"][0][0]) & set(KNOWN_EFFECTS)
    )

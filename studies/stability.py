# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Whether the last digits of the inputs change what a diagnosis says.

    python -m studies.stability [--campaigns 50] [--seed 54000000] [--jobs 2]

Campaigns of the twin and of the bench take turns. Each is diagnosed twice, the second time with
every number multiplied by 1 + 1e-8 times a normal variable, as the last digits of a table differ.
The page lists the figures that differ by more than 1 %.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import click
import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.errors import InputError
from hmcvt_tools.fleet.executors import Processes
from studies.blind import conditions, trial
from studies.blind.bench import judge
from studies.blind.bench.library import without_effects
from studies.blind.bench.properties import Bench
from studies.blind.bench.study import cases as bench_cases

RELATIVE_CHANGE = 1e-8
"""Standard deviation of the change of every number, as a part of it."""
CHANGED = 0.01
"""Fraction of a figure by which it has changed."""
MIN_FRACTION = 0.005
"""Change of a probability or of a part removed that no report prints: they print whole percents."""
MIN_ERROR = 0.01
"""Change of an error of a meter or of a parameter that no report prints, in its deviations."""
FIRST_SEED = 54_000_000
_NOISES = ("0.1 %", "0.4 %")
_IN_PERCENT = re.compile(
    r"probability$|shrinkage$|fraction$|looks\[\d+\]\.p_value$|interval\[\d\]$"
)
_IN_DEVIATIONS = "/deviation"
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class Case(NamedTuple):
    """One campaign: `generator` is twin or bench, `number` counts the campaigns of each."""

    generator: str
    number: int
    seed: int


class Record(NamedTuple):
    """What differs between two diagnoses of a campaign.

    Attributes:
        case: the campaign.
        kind: what it hides.
        verdicts: of both.
        changed: figures that differ, with both values.
        words_differ: whether the reports differ in more than numbers.
    """

    case: Case
    kind: str
    verdicts: tuple[str, str]
    changed: tuple[tuple[str, Any, Any], ...]
    words_differ: bool


def cases(campaigns: int, seed: int) -> list[Case]:
    """Return the campaigns of a run, twin and bench in turn."""
    generators = ("twin", "bench")
    return [Case(generators[i % 2], i // 2, seed) for i in range(campaigns)]


def diagnosed(
    case: Case, samples: hmcvt.BenchSamples | None = None
) -> tuple[str, hmcvt.BenchSamples, hmcvt.Diagnosis]:
    """Return what a campaign hides, its samples, and its diagnosis.

    Args:
        case: the campaign.
        samples: to diagnose in place of its own.

    Raises:
        InputError: the campaign cannot be drawn.
    """
    if case.generator == "twin":
        of_twin = twin_case(case)
        model, own = trial.at_hand(conditions.draw(of_twin))
        samples = own if samples is None else samples
        return of_twin.kind, samples, hmcvt.diagnose(model, samples)
    of_bench = bench_case(case)
    campaign, _ = judge.draw(of_bench)
    model, own = judge.served(campaign)
    samples = own if samples is None else samples
    # An unlisted loss stays unlisted, whatever the list has learnt.
    unlisted = campaign.truth.effects if of_bench.kind == "unlisted" else ()
    with without_effects(unlisted):
        return of_bench.kind, samples, hmcvt.diagnose(model, samples)


def bench_case(case: Case) -> judge.Case:
    """Return a campaign of the bench, with all its properties."""
    return bench_cases(case.number + 1, case.seed, Bench())[-1]


def twin_case(case: Case) -> conditions.Case:
    """Return a campaign of the twin: its kinds in a random order, all with other seeds."""
    work = conditions.cases(case.seed, 1, _NOISES)
    order = np.random.default_rng(case.seed).permutation(len(work))
    return work[int(order[case.number % len(work)])]


def changed_samples(samples: hmcvt.BenchSamples, seed: int) -> hmcvt.BenchSamples:
    """Return samples with other last digits; none leaves the range of its column."""
    rng = np.random.default_rng(seed)
    columns = {}
    for item in fields(samples):
        values = getattr(samples, item.name)
        if isinstance(values, np.ndarray) and values.dtype == float:
            factor = 1.0 + RELATIVE_CHANGE * rng.standard_normal(values.shape)
            columns[item.name] = values * factor
    stroke = columns["displacement_ratio"].clip(-1.0, 1.0)
    return replace(samples, **{**columns, "displacement_ratio": stroke})


def compared(case: Case) -> Record | None:
    """Diagnose a campaign twice and return what differs; None if it cannot be drawn."""
    try:
        kind, samples, first = diagnosed(case)
    except InputError:
        return None
    changed = changed_samples(samples, case.seed + case.number)
    _, _, second = diagnosed(case, changed)
    return Record(
        case,
        kind,
        (first.verdict, second.verdict),
        tuple(differences(first.to_dict(), second.to_dict())),
        _words(first.report()) != _words(second.report()),
    )


def _words(report: str) -> str:
    """Return a report without its numbers and its line breaks."""
    return " ".join(_NUMBER.sub("#", report).split())


def differences(
    one: dict[str, Any], other: dict[str, Any]
) -> Iterator[tuple[str, Any, Any]]:
    """Yield the figures of two diagnoses as plain data that differ, by their keys."""
    first = dict(_flat(one))
    second = dict(_flat(other))
    for key in sorted(first.keys() | second.keys()):
        value = first.get(key)
        changed = second.get(key)
        if _differ(key, value, changed):
            yield key, value, changed


def _differ(key: str, one: Any, other: Any) -> bool:
    least = 0.0
    if key.endswith("probability"):
        # A set that only one of the two lists has no probability in the other.
        one = one or 0.0
        other = other or 0.0
    if _IN_PERCENT.search(key):
        least = MIN_FRACTION
    if key.endswith(_IN_DEVIATIONS):
        least = MIN_ERROR
    numbers = (int, float)
    if isinstance(one, numbers) and isinstance(other, numbers):
        limit = max(CHANGED * max(abs(one), abs(other)), least)
        return abs(one - other) > limit
    return bool(one != other)


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the figures of plain data; sets and causes by their names, not by their rank."""
    if isinstance(value, dict):
        for name, deviation in (
            ("value", value.get("expected") or value.get("standard_error")),
            ("with_effect", _deviation_of_drift(value)),
        ):
            if name in value and deviation:
                in_deviations = value[name] / deviation
                value = {**value, name: None}
                yield f"{key}.{name}{_IN_DEVIATIONS}", in_deviations
        for name, item in value.items():
            yield from _flat(item, f"{key}.{name}")
    elif key.endswith(".effects"):
        # The key of the set has them already.
        return
    elif isinstance(value, list):
        if value and isinstance(value[0], list):
            # Sets with a member of a class, in the order of probabilities that are printed nowhere.
            value = sorted(value)
        for i, item in enumerate(value):
            yield from _flat(item, f"{key}[{_name_of(item) or i}]")
    else:
        yield key, value


def _deviation_of_drift(value: dict[str, Any]) -> float | None:
    """Return the standard error of a base parameter, as far as its drift tells."""
    errors = value.get("standard_errors")
    if not errors:
        return None
    return float((value["without_effect"] - value["with_effect"]) / errors)


def _name_of(item: Any) -> str:
    if isinstance(item, dict) and "effects" in item:
        return "+".join(item["effects"])
    if isinstance(item, dict):
        return str(item.get("effect", ""))
    return ""


def report(records: Sequence[Record]) -> str:
    """Return what differs, one line for each campaign and each figure."""
    verdicts = sum(record.verdicts[0] != record.verdicts[1] for record in records)
    words = sum(record.words_differ for record in records)
    stable = sum(not record.changed for record in records)
    lines = []
    for record in records:
        if record.changed or record.words_differ:
            name = f"{record.case.generator} {record.case.number}"
            lines.append(f"{name}, {record.kind}: {' -> '.join(record.verdicts)}")
            for key, one, other in record.changed:
                lines.append(f"  {key.removeprefix('.')}: {one} -> {other}")
    lines.append(
        f"{len(records)} campaigns: other verdict {verdicts}, other words {words}, "
        f"no figure changed by more than {100.0 * CHANGED:g} % in {stable}"
    )
    return "\n".join(lines)


@click.command("stability")
@click.option(
    "--campaigns", type=click.IntRange(1), default=50, show_default=True, help="All."
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=FIRST_SEED,
    show_default=True,
    help="Of the first campaign.",
)
@click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True)
def command(campaigns: int, seed: int, jobs: int) -> None:
    """Compare diagnoses of campaigns that differ in the last digits of their inputs."""
    with Processes(jobs) as pool:
        records = list(pool.map(compared, cases(campaigns, seed)))
    click.echo(report([record for record in records if record is not None]))


if __name__ == "__main__":
    command()

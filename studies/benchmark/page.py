# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The page of the benchmark: the table of all methods, failures first."""

from collections import Counter
from pathlib import Path

import yaml

from studies.benchmark.generator import TABLE_SEEDS, VERSION, digest
from studies.benchmark.methods import METHODS
from studies.benchmark.scorer import (
    FAILURES,
    SUCCESSES,
    Score,
    answered_methods,
    figures_table,
    scores_of,
    split,
)
from studies.page import machine, render, table

REASONS_FILE = Path(__file__).parent / "reasons.yaml"
"""Why a baseline is better, by figure; written by hand."""


def page(folder: Path, command: str, first_seed: int) -> str:
    """Return the page in Markdown.

    Args:
        folder: with cases, truth and answers.
        command: that made them.
        first_seed: of the cases.

    Raises:
        ValueError: hmcvt has not answered, or an answer is missing or wrong.
    """
    found = answered_methods(folder)
    # Without answers of hmcvt there is no page: baselines are compared with it.
    methods = [name for name in METHODS if name in {"hmcvt", *found}]
    methods += [name for name in found if name not in METHODS]
    every = {method: scores_of(folder, method) for method in methods}
    scores, measured = split(every)
    first = scores[methods[0]]
    kinds = Counter((each.kind, each.case.split("-")[0]) for each in first)
    rows = [
        (kind.replace("_", " "), kinds[kind, "twin"], kinds[kind, "bench"])
        for kind in dict.fromkeys(each.kind for each in first)
    ]
    return render(
        "page.md.j2",
        Path(__file__).parent,
        command=command,
        machine=machine(),
        seeds="kept apart from development"
        if first_seed >= TABLE_SEEDS
        else "used in development",
        version=VERSION,
        digest=digest(folder / "cases", folder / "truth"),
        cases=len(first),
        methods=len(methods),
        kinds=table(("hidden", "twin", "bench"), rows),
        measured=measured_table(measured),
        failures=figures_table(scores, FAILURES),
        successes=figures_table(scores, SUCCESSES),
        beaten=beaten(scores),
    )


def measured_table(scores: dict[str, list[Score]]) -> str:
    """Return the figures of measured cases that some method answered; empty without any."""
    if not any(scores.values()):
        return ""
    figures = [
        figure
        for figure in (*FAILURES, *SUCCESSES)
        if any(figure.cell(own) != "-" for own in scores.values())
    ]
    return figures_table(scores, figures)


def beaten(scores: dict[str, list[Score]]) -> str:
    """Return a line for each figure in which a baseline is better than hmcvt, with the reason."""
    reasons = yaml.safe_load(REASONS_FILE.read_text(encoding="utf-8"))
    own = scores["hmcvt"]
    lines = []
    for figure in (*FAILURES, *SUCCESSES):
        better = {
            method: figure.cell(others)
            for method, others in scores.items()
            if figure.distance(others) < figure.distance(own)
        }
        if better:
            values = ", ".join(f"{method} {cell}" for method, cell in better.items())
            reason = reasons.get(figure.what, "The reason is open.")
            lines.append(
                f"* **{figure.what}**: {values}; hmcvt {figure.cell(own)}. {reason}"
            )
    return "\n".join(lines)

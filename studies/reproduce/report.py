# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The report: a self-contained page, and Markdown with figures beside it."""

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from hmcvt_core.files.atomic import write_atomically
from hmcvt_tools.report import style
from studies.page import render, table

from . import comparison, conclusions, paper, surfaces, tables
from .algorithms import SERVED
from .figures import Drawing, drawings
from .item import BETTER, DIFFERS, NOT_REPRODUCIBLE, REPRODUCED, VERDICTS, Item
from .procedure import Reproduction
from .tables import FORMULATIONS

HTML, MARKDOWN = "report.html", "report.md"
_FOLDER = Path(__file__).parent
_TITLE = "The paper's numbers and figures, recomputed"
_MARKS = {
    REPRODUCED: "good",
    BETTER: "good",
    DIFFERS: "doubt",
    NOT_REPRODUCIBLE: "none",
}
_GROUPS = {
    "figure6": comparison.FIGURE_6,
    "ablation": comparison.ABLATION,
    "figure3": surfaces.GROUP,
    "figure4": surfaces.GROUP,
    "figure5": surfaces.GROUP,
}


def write(found: Reproduction, folder: Path, command: str) -> list[Path]:
    """Write `report.html`, `report.md` and the figures; each file whole or not at all.

    Args:
        found: what to report.
        folder: made when it does not exist.
        command: that made it, to be told.

    Returns:
        The two reports.

    Raises:
        OSError: the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = drawings(found)
    for drawing in drawn:
        write_atomically(folder / f"{drawing.name}.svg", f"{drawing.svg}\n")
        (folder / f"{drawing.name}.png").write_bytes(drawing.png)
    context = {
        "title": _TITLE,
        "counts": counts(found),
        "command": command,
        "rules": (_FOLDER / "rules.txt")
        .read_text(encoding="utf-8")
        .strip()
        .split("\n\n"),
        "sections": [
            (
                name,
                list(items),
                details(found, name),
                [each for each in drawn if _group(each) == name],
            )
            for name, items in groupby(found.items, key=lambda item: item.group)
        ],
    }
    write_atomically(
        folder / MARKDOWN,
        render(
            "report.md.j2", _FOLDER, table=table, items_table=_items_table, **context
        ),
    )
    write_atomically(
        folder / HTML, style.render("report.html.j2", _FOLDER, marks=_MARKS, **context)
    )
    return [folder / HTML, folder / MARKDOWN]


def _group(drawing: Drawing) -> str:
    return _GROUPS[drawing.name.split("-", 1)[0]]


def _items_table(items: Sequence[Item]) -> str:
    return table(
        ("item", "published", "ours", "verdict"),
        [
            (
                item.name,
                item.text(item.published),
                item.text(item.ours),
                f"**{item.verdict}**{': ' if item.why else ''}{item.why}",
            )
            for item in items
        ],
    )


def counts(found: Reproduction) -> str:
    """How many items have each verdict."""
    counted = Counter(item.verdict for item in found.items)
    parts = ", ".join(f"{counted[verdict]} {verdict}" for verdict in VERDICTS)
    return f"{len(found.items)} items: {parts}"


Table = tuple[tuple[str, ...], list[tuple[str, ...]]]
"""Heads of the columns, and rows."""


def details(found: Reproduction, group: str) -> list[Table]:
    """Tables that stand below the items of a group."""
    if group == tables.TABLE_3:
        return [_table3(found)]
    if group == conclusions.GEAR:
        return [_enumerations(found)]
    if group == comparison.FIGURE_6:
        return [_algorithms(found)]
    return []


def _table3(found: Reproduction) -> Table:
    head = (
        "gear efficiency",
        *(
            f"{column}, {name} [%]"
            for name in ("printed", *FORMULATIONS)
            for column in ("all", "fitted", "predicted")
        ),
    )
    rows = []
    for gear, printed in paper.TABLE_3.items():
        values = [
            *printed,
            *(
                value
                for name in FORMULATIONS
                for value in found.fits[name, gear].errors
            ),
        ]
        rows.append((f"{gear:g}", *(f"{value:.2f}" for value in values)))
    return head, rows


def _enumerations(found: Reproduction) -> Table:
    head = (
        "formulation",
        "objective",
        "bounds",
        "best, all data",
        "best, prediction",
        *(f"{gear:g} [%]" for gear in paper.GEAR_EFFICIENCIES),
    )
    return head, [
        (
            each.formulation,
            each.objective,
            each.box,
            f"{each.best('all_data'):g}",
            f"{each.best('prediction'):g}",
            *(f"{each.errors[gear].all_data:.2f}" for gear in paper.GEAR_EFFICIENCIES),
        )
        for each in found.enumerations
    ]


def _algorithms(found: Reproduction) -> Table:
    head = (
        "algorithm",
        "1 - RSQ, median",
        "quartiles",
        "ends near the lowest",
        "evaluations of a run",
        "per run that ends near",
        "the same, stopped there",
        "time [s]",
    )
    rows: list[tuple[str, ...]] = []
    for name, summary in found.summaries.items():
        low, middle, high = summary.quartiles("value")
        spent, seconds = (
            summary.quartiles(what)[1] for what in ("evaluations", "seconds")
        )
        rows.append(
            (
                name,
                f"{middle:.5f}",
                f"{low:.5f} to {high:.5f}",
                summary.reached_text,
                f"{spent:.0f}",
                summary.cost(summary.whole),
                summary.cost(summary.until_met) if name != SERVED else "-",
                f"{seconds:.2f}",
            )
        )
    return head, rows

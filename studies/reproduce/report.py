# SPDX-License-Identifier: Apache-2.0
"""The report: one self-contained HTML page, and Markdown with the figures as files beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.report.style import render

from . import comparison, intervals, subsets, surfaces, tables
from .figures import Drawing, drawings
from .item import BETTER, DIFFERS, NOT_REPRODUCIBLE, REPRODUCED
from .procedure import Reproduction
from .text import RULES, counts, details, groups, markdown

HTML, MARKDOWN = "report.html", "report.md"
_TITLE = "The paper's numbers and figures beside ours"
_MARKS = {REPRODUCED: "good", BETTER: "good", DIFFERS: "doubt", NOT_REPRODUCIBLE: "none"}
_GROUPS = {"table3": tables.TABLE_3, "table4": tables.TABLE_4, "figure6": comparison.FIGURE_6,
           "ablation": comparison.ABLATION, "subsets": subsets.GROUP, "profile": intervals.GROUP,
           "figure3": surfaces.GROUP, "figure4": surfaces.GROUP, "figure5": surfaces.GROUP}


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
    images = [(_group(each), each.title, each.caption, f"{each.name}.png") for each in drawn]
    write_atomically(folder / MARKDOWN, markdown(found, command, images))
    write_atomically(folder / HTML, html(found, command, drawn))
    return [folder / HTML, folder / MARKDOWN]


def html(found: Reproduction, command: str, drawn: Sequence[Drawing]) -> str:
    """Return the page; it loads nothing and needs no script."""
    sections = [(name, items, details(found, name),
                 [each for each in drawn if _group(each) == name])
                for name, items in groups(found)]
    return render("report.html.j2", Path(__file__).parent, title=_TITLE, counts=counts(found),
                  command=command, sections=sections, rules=RULES, marks=_MARKS)


def _group(drawing: Drawing) -> str:
    return _GROUPS[drawing.name.split("-", 1)[0]]

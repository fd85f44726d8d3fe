# SPDX-License-Identifier: Apache-2.0
"""The report: one self-contained HTML page, and Markdown with the figures as files beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.report.page.style import STYLE
from hmcvt_core.report.page.svg import element, text

from . import comparison, intervals, subsets, surfaces, tables
from .figures import Drawing, drawings
from .item import BETTER, DIFFERS, NOT_REPRODUCIBLE, REPRODUCED, Item
from .procedure import Reproduction
from .text import RULES, counts, details, groups, markdown

HTML, MARKDOWN = "report.html", "report.md"
_TITLE = "The paper's numbers and figures beside ours"
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_MARKS = {REPRODUCED: "good", BETTER: "good", DIFFERS: "doubt", NOT_REPRODUCIBLE: "none"}
_EXTRA = """
td { white-space: normal; vertical-align: top; }
td.name { min-width: 15em; max-width: 26em; } td.words { min-width: 12em; max-width: 34em; }
td.number { min-width: 5em; }
.tag.good { border-color: #111; font-weight: 700; }
figure { margin: 12px 0 6px; min-width: 0; }
figure > svg { width: 100%; height: auto; display: block; }
figcaption { font-size: 14px; color: var(--soft); }
.figures { grid-template-columns: repeat(auto-fit, minmax(min(100%, 440px), 1fr)); }
.figures figure > svg { max-width: 620px; }
@media (max-width: 620px) {
  table.items, table.items tbody, table.items tr, table.items td { display: block; }
  table.items thead { display: none; }
  table.items tr { border-bottom: 1px solid var(--rule); padding: 8px 0; }
  table.items td { border: 0; padding: 1px 0; text-align: left; min-width: 0; max-width: none; }
  table.items td.name { font-weight: 600; }
  table.items td.number::before { content: attr(data-name) ": "; color: var(--soft); }
}
"""
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
        write_atomically(folder / f"{drawing.name}.svg", _standalone(drawing))
        (folder / f"{drawing.name}.png").write_bytes(drawing.png)
    images = [(_group(each), each.title, each.caption, f"{each.name}.png") for each in drawn]
    write_atomically(folder / MARKDOWN, markdown(found, command, images))
    write_atomically(folder / HTML, html(found, command, drawn))
    return [folder / HTML, folder / MARKDOWN]


def html(found: Reproduction, command: str, drawn: list[Drawing]) -> str:
    """Return the page; it loads nothing and needs no script."""
    head = "\n".join([
        '<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f'<meta http-equiv="Content-Security-Policy" content="{text(_POLICY)}">',
        element("title", text(_TITLE)), f"<style>{STYLE}{_EXTRA}</style>"])
    top = element(
        "header", element("h1", text(_TITLE)), element("p", text(counts(found)), class_="verdict"),
        element("p", "Written by ", element("code", text(command)), ".", class_="lead"),
        class_="top")
    rules = element("section", element("h2", "How this was judged"),
                    *(element("p", text(rule)) for rule in RULES))
    sections = [_section(found, name, items, [each for each in drawn if _group(each) == name])
                for name, items in groups(found)]
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{top}\n'
            f'{element("main", *sections, rules)}\n</body>\n</html>\n')


def _section(found: Reproduction, name: str, items: list[Item], drawn: list[Drawing]) -> str:
    rows = [element("tr", element("td", text(item.name), class_="name"),
                    element("td", text(item.published_text), class_="number",
                            data_name="published"),
                    element("td", text(item.ours_text), class_="number", data_name="ours"),
                    element("td", _verdict(item), class_="words")) for item in items]
    head = element("tr", element("th", "item"), element("th", "published", class_="number"),
                   element("th", "ours", class_="number"), element("th", "verdict"))
    tables_ = [_scroll("items", element("thead", head), element("tbody", *rows))]
    for titles, lines in details(found, name):
        tables_.append(_scroll("detail", element("thead", _row("th", titles)),
                               element("tbody", *(_row("td", line) for line in lines))))
    figures = element("div", *(_figure(each) for each in drawn), class_="figures") if drawn else ""
    return element("section", element("h2", text(name)), *tables_, figures)


def _row(kind: str, cells: Sequence[str]) -> str:
    return element("tr", *(element(kind, text(cell)) for cell in cells))


def _verdict(item: Item) -> str:
    tag = element("span", text(item.verdict), class_=f"tag {_MARKS[item.verdict]}")
    return tag + (f" {text(item.why)}" if item.why else "")


def _scroll(kind: str, *content: str) -> str:
    return element("div", element("table", *content, class_=kind), class_="scroll")


def _figure(drawing: Drawing) -> str:
    return element("figure", drawing.svg, element(
        "figcaption", text(f"{drawing.title}. {drawing.caption}")))


def _group(drawing: Drawing) -> str:
    return _GROUPS[drawing.name.split("-", 1)[0]]


def _standalone(drawing: Drawing) -> str:
    return f'<?xml version="1.0" encoding="utf-8"?>\n{drawing.svg}\n'

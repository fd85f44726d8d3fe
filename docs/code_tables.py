# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Write the tables of the pages that repeat the code: `python docs/code_tables.py`.

A test compares the pages with what this script would write.
"""

from itertools import groupby
from pathlib import Path

from hmcvt_core.physics.effects import library
from hmcvt_core.physics.effects.base import Effect, EffectParameter
from hmcvt_core.transmission.quantities import STORED, Quantity

FOLDER = Path(__file__).parent


def pages() -> dict[str, str]:
    """Return the text of every page with its tables, by file name."""
    tables = {"effects.md": effects(), "files.md": bench_columns()}
    return {
        name: _with_table((FOLDER / name).read_text(encoding="utf-8"), table)
        for name, table in tables.items()
    }


def bench_columns() -> str:
    """Return the columns of a bench file as Markdown."""
    rows = [_column(column) for column in STORED]
    head = "| column | symbol | unit | allowed | meaning |\n|---|---|---|---|---|\n"
    return head + "".join(rows)


def effects() -> str:
    """Return one section for each effect as Markdown."""
    # The library holds effects of other packages too, once they are imported.
    kinds = [
        kind
        for kind in library(units=True)
        if kind.__module__.startswith("hmcvt_core.")
    ]
    sections = [
        _section(name, list(forms))
        for name, forms in groupby(kinds, key=lambda kind: kind.name)
    ]
    return "\n".join(sections)


def _with_table(text: str, table: str) -> str:
    begin, end = "<!-- table: begin -->\n", "<!-- table: end -->\n"
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    return f"{before}{begin}\n{table}\n{end}{after}"


def _column(column: Quantity) -> str:
    meaning = column.meaning + (" (required)" if column.required else "")
    allowed = f"{column.low:g} to {column.high:g}"
    symbol = column.symbol or "-"
    return f"| `{column.name}` | {symbol} | {column.unit} | {allowed} | {meaning} |\n"


def _section(name: str, forms: list[type[Effect]]) -> str:
    lines = [f"### {name}\n"]
    lines.append("| form | acts on | law | parameters |")
    lines.append("|---|---|---|---|")
    lines += [_form(form) for form in forms]
    remedies = sorted({form.remedy for form in forms if form.remedy})
    if remedies:
        lines.append(f"\nSettled by: {'; '.join(remedies)}.")
    sources = list(dict.fromkeys(form.source for form in forms if form.source))
    lines.append(f"\nSource: {'; '.join(sources)}.\n")
    return "\n".join(lines)


def _form(form: type[Effect]) -> str:
    law = (form.__doc__ or "").splitlines()[0].replace("|", "\\|")
    component = form.component + (" (unit bench)" if form.unit_only else "")
    parameters = "; ".join(_parameter(item) for item in form.parameters())
    return f"| {form.form or '-'} | {component} | {law} | {parameters} |"


def _parameter(item: EffectParameter) -> str:
    name = f"`{item.name}`" + ("" if item.unit == "-" else f" [{item.unit}]")
    if item.is_size:
        return f"{name} {item.typical:g} ({item.low:g} to {item.high:g})"
    values = ", ".join(f"{value:g}" for value in item.grid)
    if item.within_grid:
        return f"{name} tried at {values}"
    return f"{name} tried at {values}, refitted from {item.low:g} to {item.high:g}"


if __name__ == "__main__":
    for page, text in pages().items():
        (FOLDER / page).write_text(text, encoding="utf-8")

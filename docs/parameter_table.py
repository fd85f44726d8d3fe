# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Write the table of parameters in docs/node-reference.md.

`python docs/parameter_table.py` writes it.
"""

from pathlib import Path

from hmcvt_ros.parameters import PARAMETERS, Declaration

PAGE = Path(__file__).with_name("node-reference.md")
BEGIN, END = "<!-- parameters: begin -->\n", "<!-- parameters: end -->\n"


def table() -> str:
    """Return the table as Markdown."""
    lines = [
        "| parameter | default | allowed | at run time | |",
        "|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *map(_row, PARAMETERS)]) + "\n"


def page(text: str) -> str:
    """Return the text of the page with the table in its place."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}{table()}{END}{after}"


def _row(item: Declaration) -> str:
    name = f"`{item.name}`" + (f" [{item.unit}]" if item.unit else "")
    # An empty text has no other way to be seen.
    default = f"`{item.default}`" if item.default != "" else '`""`'
    changes = "yes"
    if item.read_only:
        changes = "no"
    elif item.protects:
        changes = "limit"
    return f"| {name} | {default} | {item.allowed} | {changes} | {item.description} |"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

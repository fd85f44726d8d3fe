# SPDX-License-Identifier: Apache-2.0
"""What all pictures share: style, and the file formats they are written in.

Readable in grey and on a projector: large letters, dark lines, and marks or hatches wherever colour
tells things apart.
"""

from __future__ import annotations

import html
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...files.atomic import write_atomically

FORMATS = (".png", ".svg", ".html")
_SIZE = (10.0, 6.4)
_STYLE: Any = {
    "font.family": "DejaVu Sans", "font.size": 15.0, "axes.titlesize": 16.0,
    "axes.titlelocation": "left", "legend.fontsize": 13.0, "axes.grid": True, "grid.color": "0.88",
    "axes.axisbelow": True, "axes.spines.top": False, "axes.spines.right": False,
    "figure.constrained_layout.use": True, "hatch.linewidth": 0.7, "svg.hashsalt": "hmcvt",
    "svg.fonttype": "none",  # text that can be searched and read out
}
_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<style>body{{margin:2vmin auto;max-width:1100px;padding:0 12px;font-family:sans-serif}}
svg{{width:100%;height:auto}}</style></head>
<body>{svg}</body></html>
"""


def writes(path: str) -> str:
    """Return the format of a picture's file.

    Raises:
        InputError: the ending names none of `FORMATS`, or matplotlib is missing.
    """
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise InputError(f"{path}: a picture ends in {', '.join(FORMATS)}")
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise InputError("pictures need matplotlib; in the folder of hmcvt: "
                         "pip install '.[plot]'") from error
    return ending


def save(draw: Callable[[Any], None], path: str | os.PathLike[str]) -> None:
    """Draw on an empty matplotlib figure and write it, whole or not at all.

    Args:
        draw: takes the figure.
        path: ends in one of `FORMATS`; an HTML page holds the picture in itself.

    Raises:
        InputError: see `writes`.
        OSError: the file cannot be written.
    """
    ending = writes(os.fspath(path))
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=_SIZE)
        draw(figure)
        buffer = io.BytesIO()
        if ending == ".png":
            figure.savefig(buffer, format="png", dpi=130)
            write_atomically(Path(path), buffer.getvalue())
            return
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    svg = buffer.getvalue().decode()
    if ending == ".html":
        title = html.escape(figure.axes[0].get_title(loc="left").splitlines()[0])
        picture = svg[svg.index("<svg"):].replace(
            "<svg", f'<svg role="img" id="picture" aria-label="{title}"', 1)
        # Verdana has the same widths where DejaVu is not installed.
        picture = picture.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, sans-serif")
        svg = _PAGE.format(title=title, svg=picture)
    write_atomically(Path(path), svg)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The core's own files: bench tables, YAML, shipped data; atomic writes, strict JSON.

bench       `BenchSamples` and its CSV
table       strict CSV: named columns, no broken row
text        encodings and rows of cells
numbers     numbers in cells
plain_yaml  YAML of a known schema
atomic      files written whole or not at all
checks      types of arguments that public functions take

This module has `data_path` (of a shipped file) and what results call: `picture` for their figure,
`plain` for JSON data, `preformatted` for their text in a notebook.
"""

import html
import math
from collections.abc import Mapping
from functools import singledispatch
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..moved import tools

_PACKAGE = Path(__file__).resolve().parents[1]


def data_path(name: str) -> Path:
    """Return the path of a shipped file, such as `params/hm4.yaml` or `data/table2.csv`.

    An installed package holds `data/` and `params/` inside; a checkout has them next to it.

    Raises:
        InputError: there is no such file.
    """
    for root in (_PACKAGE, _PACKAGE.parent):
        if (root / name).is_file():
            return root / name
    raise InputError(f"{name} does not ship with hmcvt")


@singledispatch
def picture(shown: Any, *options: Any, **named: Any) -> Any:
    """Return a matplotlib figure of a result.

    `hmcvt_tools.report` draws each kind and registers here. It is imported when a picture is asked
    for.

    Raises:
        TypeError: nothing draws results of this kind.
        InputError: matplotlib is missing.
    """
    tools("hmcvt_tools.report")
    draw = picture.dispatch(type(shown))
    if draw is picture.dispatch(object):
        raise TypeError(f"there is no picture of {type(shown).__name__}")
    return draw(shown, *options, **named)


def preformatted(text: str) -> str:
    """Return text as a notebook shows it."""
    return f"<pre>{html.escape(text)}</pre>"


def plain(value: Any) -> Any:
    """Return data that strict JSON can hold; NaN and infinity become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

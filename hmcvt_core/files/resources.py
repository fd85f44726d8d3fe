# SPDX-License-Identifier: Apache-2.0
"""Files that ship with hmcvt: the paper's data and parameter files."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError

_PACKAGE = Path(__file__).resolve().parents[1]


def data_path(name: str) -> Path:
    """Return the path of a shipped file, such as `params/hm4.yaml` or `data/table2.csv`.

    An installed package holds `data/` and `params/` inside; a checkout has them beside it.

    Raises:
        InputError: there is no such file.
    """
    for root in (_PACKAGE, _PACKAGE.parent):
        if (root / name).is_file():
            return root / name
    raise InputError(f"{name} does not ship with hmcvt")

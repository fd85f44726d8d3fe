# SPDX-License-Identifier: Apache-2.0
"""Files that are numbered on, 0001 and up, of which the newest are kept."""

from __future__ import annotations

import contextlib
from pathlib import Path

from hmcvt_core.files.atomic import make_folder


def next_name(folder: Path) -> Path:
    """Return a path in `folder`, without a suffix, whose number is above all there.

    Raises:
        OSError: the folder cannot be made or read.
    """
    make_folder(folder)
    return folder / f"{max(_numbers(folder), default=0) + 1:04d}"


def keep_newest(folder: Path, count: int) -> None:
    """Remove numbered files but those with the `count` highest numbers; others are left alone."""
    kept = set(sorted(_numbers(folder))[-count:])
    for path in _numbered(folder):
        if int(path.stem) not in kept:
            with contextlib.suppress(OSError):  # a file more does no harm
                path.unlink()


def _numbers(folder: Path) -> set[int]:
    return {int(path.stem) for path in _numbered(folder)}


def _numbered(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.stem.isdecimal() and path.is_file()]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which reader opens a log."""

from __future__ import annotations

import os
from pathlib import Path

from hmcvt_core.errors import InputError

from . import can_files, mdf, tdms
from .bus import BusLog
from .dbc import read_dbc
from .series import Log

SUFFIXES = (*can_files.SUFFIXES, *mdf.SUFFIXES, *tdms.SUFFIXES)
"""Endings of files that are logs; `.dat` is one where it begins as an MDF file does."""


def is_log(path: str | os.PathLike[str]) -> bool:
    """Whether a file is a log of a machine, by its ending and its first bytes."""
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        return False
    if suffix != ".dat":
        return True
    try:
        with file.open("rb") as content:
            return content.read(8).startswith(mdf.STARTS)
    except OSError:
        return False


def open_log(
    path: str | os.PathLike[str], dbc: str | os.PathLike[str] | None = None
) -> Log:
    """Open a log: MDF (.mf4, .mdf, .dat), TDMS, or a CAN trace (.blf, .asc, .trc, .log).

    Args:
        path: of the file.
        dbc: signals of a maker's messages, for a CAN trace or an MDF file with frames.

    Raises:
        InputError: the file is missing, damaged or of another kind, its package is not
            installed, or a DBC is given for a file without frames.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"{path}: no such file")
    if not is_log(file):
        raise InputError(
            f"{path}: is no log that hmcvt reads; there is {', '.join(SUFFIXES)}"
        )
    if file.stat().st_size == 0:
        raise InputError(f"{path}: is empty")
    messages = [] if dbc is None else read_dbc(Path(dbc))
    suffix = file.suffix.lower()
    if suffix in can_files.SUFFIXES:
        return BusLog(
            file,
            lambda remarks: can_files.read_frames(file, remarks),
            messages,
            dbc=str(dbc or ""),
        )
    if suffix in mdf.SUFFIXES:
        opened = mdf.open_mdf(file)
        if mdf.holds_frames(opened):
            return BusLog(
                file,
                lambda remarks: mdf.frames_of(opened, remarks),
                messages,
                opened.close,
                str(dbc or ""),
            )
        if dbc is None:
            return mdf.MdfLog(file, opened)
        opened.close()
    elif dbc is None:
        return tdms.open_tdms(file)
    raise InputError(f"{path}: holds no CAN frame, so that {dbc} decodes nothing")

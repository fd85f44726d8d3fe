# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A folder that is written whole or not at all."""

import os
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import sync_folder


def require_new(folder: Path) -> None:
    """Raise an `InputError` unless a folder can be made."""
    if folder.exists() or folder.is_symlink():
        raise InputError(f"{folder}: exists; name a folder that does not exist yet")
    parent = folder.absolute().parent
    if not (parent.is_dir() and os.access(parent, os.W_OK)):
        raise InputError(f"{folder}: {parent} is not a folder that can be written")


def write_folder(folder: Path, texts: Mapping[str, str]) -> None:
    """Write a new folder of text files.

    The files are written to a temporary folder next to it, which takes the name at the end. A
    process that is killed leaves the temporary folder, and nothing under the name.

    Args:
        folder: does not exist.
        texts: content by file name.

    Raises:
        InputError: the folder exists, or cannot be made.
        OSError: the disk is full.
    """
    require_new(folder)
    parent = folder.absolute().parent
    temporary = parent / f".{folder.name}.{secrets.token_hex(4)}.tmp"
    try:
        temporary.mkdir()
        for name, text in texts.items():
            _write_file(temporary / name, text)
        temporary.rename(folder)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        # The user knows the folder asked for, not the temporary one next to it.
        raise OSError(error.errno, error.strerror, str(folder)) from error
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    sync_folder(parent)


def _write_file(path: Path, text: str) -> None:
    """Write a file and wait until it is on disk."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())

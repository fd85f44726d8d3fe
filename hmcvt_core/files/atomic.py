# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Files that are written whole or not at all, and what it takes that they stay."""

import contextlib
import os
import re
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

_SUFFIX = ".tmp"
_LEFTOVER = re.compile(r"\..+\.[a-z0-9_]{8}" + re.escape(_SUFFIX))


def write_atomically(path: Path, content: str | bytes) -> None:
    """Replace `path` by `content` so that a crash leaves the old file or the new one.

    A link stays a link, and what is no regular file (a device, a pipe) is written to.

    Raises:
        OSError: the folder cannot be written or is full; the old file is untouched.
    """
    data = content.encode() if isinstance(content, str) else content
    target = Path(os.path.realpath(path))
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            path.write_bytes(data)
            return
        with _replacing(target, "xb") as file:
            file.write(data)
    except OSError as error:
        # The user knows the file asked for, not the temporary one next to it.
        raise OSError(error.errno, error.strerror, str(path)) from error
    sync_folder(target.parent)


def make_folder(path: Path) -> None:
    """Make a folder and those above it, so that a power cut does not take them away again.

    Raises:
        OSError: one cannot be made, or is no folder.
    """
    if not path.is_dir():
        if path.parent != path:
            make_folder(path.parent)
        path.mkdir(exist_ok=True)
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on disk; not every system can do that."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def free_name(path: Path, why: str) -> Path:
    """Return a name next to `path`, such as `log.damaged-1.csv`, with a number above all there."""
    prefix = f"{path.stem}.{why}-"
    number = max(numbered(path.parent, prefix).values(), default=0) + 1
    return path.with_name(f"{prefix}{number}{path.suffix}")


def numbered(folder: Path, prefix: str = "") -> dict[Path, int]:
    """Return what a folder holds under a prefix and a number, whatever the suffix."""
    return {
        path: int(path.stem.removeprefix(prefix))
        for path in folder.iterdir()
        if path.stem.startswith(prefix) and path.stem.removeprefix(prefix).isdecimal()
    }


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of writes that were killed.

    For a folder in which no one writes at the moment; a write under way there would fail.
    """
    with contextlib.suppress(OSError):  # a file more does no harm
        for path in folder.iterdir():
            if _LEFTOVER.fullmatch(path.name) and path.is_file():
                path.unlink()


@contextlib.contextmanager
def _replacing(target: Path, mode: str, **options: Any) -> Iterator[IO[Any]]:
    """Open a temporary file that takes the place of a target once it is complete.

    Args:
        target: of the file.
        mode: of a new file.
        options: of `Path.open`.
    """
    # Not by tempfile, which makes it private: a parameter file is read by others.
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}{_SUFFIX}")
    try:
        with temporary.open(mode, **options) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextlib.contextmanager
def growing_file(path: Path) -> Iterator[IO[str]]:
    """Open a text file that takes the place of `path` once it is complete.

    Args:
        path: of the file; a device or a pipe is written to directly.

    Raises:
        OSError: the folder cannot be written or is full; the old file is untouched.
    """
    if path.exists() and not path.is_file():
        with path.open("w", encoding="utf-8", newline="") as file:
            yield file
        return
    target = Path(os.path.realpath(path))
    with _replacing(target, "x", encoding="utf-8", newline="") as file:
        yield file
    sync_folder(target.parent)

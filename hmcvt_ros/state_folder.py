# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The state folder of a node: what it keeps over restarts, locked for one node.

Others may be able to write into the folder, or to exchange parts of it while the node runs. So the
node follows no link in it, and it removes only files that it wrote itself, by name and content.
"""

import contextlib
import errno
import fcntl
import json
import os
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from hmcvt_core import InputError
from hmcvt_core.interface import (
    make_folder,
    numbered,
    remove_leftovers,
    write_atomically,
)

KEPT_STARTS = 30
"""Starts of the node within which nothing that was written is removed; chosen by us. Ages count in
starts, because the clock of a machine may be wrong by years."""
_STARTS = "starts.json"
"""File with the highest numbers of the files that each of the last starts found."""
_NUMBERED = re.compile(r"(.*?)(\d+)[.]\w+")
"""Name of a numbered file: what it begins with, and its number."""
KEPT_FILES = 1000
KEPT_BYTES = 100 << 20
"""Files of one kind beyond which the oldest are removed, or no more are written."""
_STATE_BYTES = 1 << 20
"""Largest size of a file that keeps the state; 500 versions take 60 kB."""
_BLOCK = 4096
"""Space that a small file takes on a disk [bytes]."""
_MARK_WITHIN = 65_536
"""Bytes of a file in which its marks are looked for."""


class StateFolder:
    """A folder that no other node uses meanwhile, cleared of what killed writes left.

    The folder itself is locked, not a file in it: nothing has to be written, so this works on a
    full disk and in a read-only folder, and the kernel releases the lock however a node ends.

    Attributes:
        path: path of the folder.
        writable: whether anything can be kept in it, as far as can be seen at the start.
        complaint: what is wrong with it at the start, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path) -> None:
        """Create the folder if needed, and lock it.

        Raises:
            InputError: another node has locked it.
        """
        self.path = path
        self.writable = False
        self.complaint = ""
        self._unlocked = ""
        self._handle: int | None = None
        try:
            make_folder(path)
            self._handle = os.open(path, os.O_RDONLY)
        except OSError as error:
            # Nothing can be logged or refitted, but the model can still be served.
            self.complaint = f"state_folder: {error}"
            return
        self._lock(self._handle)
        self.writable = os.access(path, os.W_OK)
        if not self.writable:
            self.complaint = (
                f"state_folder: {path} cannot be written: no logging, no refits"
            )
        elif not self.complaint:
            remove_leftovers(path)
            for folder in path.iterdir():
                if folder.is_dir() and not folder.is_symlink():
                    remove_leftovers(folder)
            self._count_start()

    def trouble(self) -> str:
        """Return what is wrong with the folder now; empty when nothing.

        It was removed or replaced, so that another node may lock the one that took its name; or it
        cannot be locked.
        """
        with contextlib.suppress(OSError):
            if self._handle is None or os.path.samestat(
                os.fstat(self._handle), self.path.lstat()
            ):
                return self._unlocked
        return (
            f"state_folder: {self.path} was removed or replaced; start the node again"
        )

    def close(self) -> None:
        """Release the folder."""
        if self._handle is not None:
            # A process that the program has forked holds the folder open too, and with it the lock.
            with contextlib.suppress(OSError):
                fcntl.flock(self._handle, fcntl.LOCK_UN)
            os.close(self._handle)
            self._handle = None

    def _count_start(self) -> None:
        """Note which files are there at this start, so that their ages can be counted."""
        # Without it all files count as recent, and nothing is removed.
        with contextlib.suppress(OSError):
            require_plain_path(self.path / _STARTS)
            starts = [*_starts(self.path), _highest_numbers(self.path)]
            text = json.dumps(starts[-KEPT_STARTS - 1 :])
            write_atomically(self.path / _STARTS, f"{text}\n")

    def _lock(self, handle: int) -> None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise InputError(
                f"state_folder: {self.path} is in use by another node; give each node its "
                "name, namespace or state_folder"
            ) from None
        except OSError as error:
            # Some network file systems cannot lock; that is no reason not to serve.
            self._unlocked = (
                f"state_folder: {self.path} cannot be locked ({error.strerror}); "
                "make sure that no other node uses it"
            )
            self.complaint = self._unlocked


@dataclass(frozen=True)
class Series:
    """Numbered files that the node writes into one folder.

    Attributes:
        pattern: expression that all of the name matches.
        marks: texts that the content of each file holds near its beginning.
    """

    pattern: str
    marks: tuple[bytes, ...]

    def has(self, name: str) -> bool:
        """Whether a name is one of the series."""
        return re.fullmatch(self.pattern, name) is not None

    def wrote(self, path: Path) -> bool:
        """Whether the content of a file is what the node writes."""
        with path.open("rb") as file:
            head = file.read(_MARK_WITHIN)
        return all(mark in head for mark in self.marks)


MODELS = Series(r"\d{4,}\.yaml", (b"schema: hmcvt-model/", b"source: hmcvt refit,"))
"""Refits, in `models` and `candidates`."""
PAGES = Series(r"\d{4,}\.html", (b"<!DOCTYPE html>",))
PAGE_DATA = Series(r"\d{4,}\.json", (b'"verdict":',))
"""Pages of diagnoses and their data, in `reports`."""


def working_directory_trouble() -> str:
    """Return what is wrong with the working directory; empty when nothing."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return (
            "the working directory was removed: files with relative names and the processes of "
            "refits and diagnoses cannot be found; start the node in another one"
        )
    return ""


def require_regular(path: Path) -> None:
    """Refuse a pipe or a device where a file should be: reading it might never end.

    Raises:
        InputError: it is one.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError(f"{path}: is no regular file")


def read_small(path: Path) -> str:
    """Return the text of a file that the node wrote to keep its state.

    Raises:
        ValueError: it is much longer than the node writes it, no text, or no regular file.
        OSError: it cannot be read.
    """
    require_regular(path)
    size = path.stat().st_size
    if size > _STATE_BYTES:
        raise ValueError(f"{size} bytes; allowed are {_STATE_BYTES}")
    return path.read_text(encoding="utf-8")


def require_plain_path(path: Path) -> None:
    """Refuse a link, a pipe or a device where a folder or file of the node should be.

    Raises:
        OSError: it is one.
    """
    if path.is_symlink():
        raise OSError(
            errno.ELOOP, "is a link, and the node follows none here", str(path)
        )
    if path.exists() and not path.is_file() and not path.is_dir():
        raise OSError(errno.EINVAL, "is no regular file", str(path))


def next_name(
    folder: Path, *series: Series, spared: Collection[str] = (), prefix: str = ""
) -> Path:
    """Return a path in `folder`, such as 0001, without a suffix, numbered above all others.

    Args:
        folder: folder of the files, which is made where needed.
        series: files among which room is made, see `make_room`.
        spared: names of files to keep in any case.
        prefix: beginning of the name.

    Raises:
        OSError: the folder is a link, cannot be created or read, or is full of recent files.
    """
    require_plain_path(folder.parent)
    require_plain_path(folder)
    make_folder(folder)
    for one in series:
        make_room(folder, one, spared)
    number = max(numbered(folder, prefix).values(), default=0) + 1
    if prefix:
        return folder / f"{prefix}{number}"
    return folder / f"{number:04d}"


def is_old(path: Path) -> bool:
    """Whether a numbered file of a state folder was there `KEPT_STARTS` starts ago."""
    match = _NUMBERED.fullmatch(path.name)
    if match is None:
        return False
    folder = path.parent
    root = folder if (folder / _STARTS).is_file() else folder.parent
    starts = _starts(root)
    if len(starts) <= KEPT_STARTS:
        return False
    key = f"{folder.relative_to(root)}/{match[1]}"
    return int(match[2]) <= starts[-KEPT_STARTS - 1].get(key, 0)


def _highest_numbers(root: Path) -> dict[str, int]:
    """Return the highest numbers of files in a state folder, by the beginnings of paths."""
    folders = [root]
    for path in root.iterdir():
        if path.is_dir() and not path.is_symlink():
            folders.append(path)
    highest: dict[str, int] = {}
    for folder in folders:
        for path in folder.iterdir():
            match = _NUMBERED.fullmatch(path.name)
            if match:
                key = f"{folder.relative_to(root)}/{match[1]}"
                highest[key] = max(highest.get(key, 0), int(match[2]))
    return highest


def _starts(root: Path) -> list[dict[str, int]]:
    """Return the highest numbers that each of the last starts found; empty where not known."""
    try:
        starts = json.loads(read_small(root / _STARTS))
    except (OSError, ValueError, RecursionError):
        return []
    intact = isinstance(starts, list) and all(
        isinstance(start, dict)
        and all(isinstance(number, int) for number in start.values())
        for start in starts
    )
    return starts if intact else []


def make_room(folder: Path, series: Series, spared: Collection[str] = ()) -> None:
    """Remove the oldest files of a series while they are too many or too large.

    Only files that are old are removed (`is_old`): a flood of requests must not push out what was
    written before it.

    Raises:
        OSError: there is no room, because the files are recent.
    """
    files = []
    for entry in os.scandir(folder):
        if entry.is_file(follow_symlinks=False) and series.has(entry.name):
            files.append((entry.stat(follow_symlinks=False), Path(entry.path)))
    # By number, of which names of a series have one; the clock may have been wrong.
    files.sort(key=lambda file: (len(file[1].name), file[1].name))
    count = len(files)
    size = sum(max(status.st_size, _BLOCK) for status, _ in files)
    for status, path in files:
        if count < KEPT_FILES and size < KEPT_BYTES:
            return
        if not is_old(path):
            break
        if path.name in spared or not series.wrote(path):
            continue
        path.unlink()
        count -= 1
        size -= max(status.st_size, _BLOCK)
    if count >= KEPT_FILES or size >= KEPT_BYTES:
        raise OSError(
            errno.ENOSPC,
            f"holds {count} files like it, {size >> 20} MiB, and removes none of the last "
            f"{KEPT_STARTS} starts; remove some by hand",
            str(folder),
        )

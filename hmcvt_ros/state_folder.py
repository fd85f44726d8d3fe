# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The state folder of a node: what it keeps over restarts, locked for one node; numbered files."""

import contextlib
import fcntl
import os
from collections.abc import Collection
from pathlib import Path

from hmcvt_core import InputError
from hmcvt_core.interface import make_folder, numbered, remove_leftovers


class StateFolder:
    """A folder that no other node uses meanwhile, cleared of what killed writes left.

    The folder itself is locked, not a file in it: nothing has to be written, so this works on a
    full disk and in a read-only folder, and the kernel releases the lock however a node ends.

    Attributes:
        path: path of the folder.
        writable: whether anything can be kept in it, as far as can be seen at the start.
        complaint: what is wrong with it, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path) -> None:
        """Create the folder if needed, and lock it.

        Raises:
            InputError: another node has locked it.
        """
        self.path = path
        self.writable = False
        self.complaint = ""
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
            for folder in (path, *filter(Path.is_dir, path.iterdir())):
                remove_leftovers(folder)

    def gone(self) -> str:
        """Return a complaint if the folder was removed or replaced; empty otherwise.

        Another node may lock the folder that took its name.
        """
        with contextlib.suppress(OSError):
            if self._handle is None or os.path.samestat(
                os.fstat(self._handle), self.path.stat()
            ):
                return ""
        return (
            f"state_folder: {self.path} was removed or replaced; start the node again"
        )

    def close(self) -> None:
        """Release the folder."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

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
            self.complaint = (
                f"state_folder: {self.path} cannot be locked ({error.strerror}); "
                "make sure that no other node uses it"
            )


def next_name(folder: Path, kept: int, spared: Collection[str] = ()) -> Path:
    """Return a path in `folder`, such as 0001, without a suffix, numbered above all others.

    Of the numbered files only the newest are kept, so that `kept` remain with this one.

    Raises:
        OSError: the folder cannot be created or read.
    """
    make_folder(folder)
    keep_newest(folder, kept - 1, spared=spared)
    return folder / f"{max(numbered(folder).values(), default=0) + 1:04d}"


def keep_newest(
    folder: Path, count: int, prefix: str = "", spared: Collection[str] = ()
) -> None:
    """Remove files named by a prefix and a number except those with the highest numbers.

    Args:
        folder: folder of the files.
        count: numbers to keep.
        prefix: beginning of the names; files with other names stay.
        spared: names of files to keep in addition.
    """
    with contextlib.suppress(OSError):  # one file more does no harm
        numbers = {
            path: number
            for path, number in numbered(folder, prefix).items()
            if path.name not in spared
        }
        kept = sorted(set(numbers.values()))[-count:]
        for path, number in numbers.items():
            if number not in kept:
                path.unlink()

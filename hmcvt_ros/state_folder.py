# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The folder in which a node keeps, for itself alone, what must outlive it; numbered files."""

import contextlib
import fcntl
import os
from collections.abc import Collection
from pathlib import Path

from hmcvt_core import InputError
from hmcvt_core.files.atomic import make_folder, numbered, remove_leftovers


class StateFolder:
    """A folder that no other node uses meanwhile, cleared of what killed writes left.

    The folder itself is locked, not a file in it: nothing has to be written, so that it works on a
    full disk and in a read-only folder, and the kernel takes the lock back however a node ends.

    Attributes:
        path: the folder.
        writable: whether anything can be kept in it, as far as can be told at start.
        complaint: what is wrong with it, as a sentence; empty when nothing.
    """

    def __init__(self, path: Path) -> None:
        """Make the folder if need be, and take it.

        Raises:
            InputError: another node has it.
        """
        self.path = path
        self.writable = False
        self.complaint = ""
        self._handle: int | None = None
        try:
            make_folder(path)
            self._handle = os.open(path, os.O_RDONLY)
        except OSError as error:
            # Nothing can be logged or refitted; what is there can still be served.
            self.complaint = f"state_folder: {error}"
            return
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise InputError(
                f"state_folder: {path} is in use by another node; give each node a name, a "
                "namespace or a state_folder of its own"
            ) from None
        except OSError as error:
            # Some network file systems cannot; that is no reason not to serve.
            self.complaint = (
                f"state_folder: {path} cannot be locked ({error.strerror}); "
                "see to it that no other node uses it"
            )
        self.writable = os.access(path, os.W_OK)
        if not self.writable:
            self.complaint = (
                f"state_folder: {path} cannot be written: no logging, no refits"
            )
        elif not self.complaint:
            for folder in (path, *filter(Path.is_dir, path.iterdir())):
                remove_leftovers(folder)

    def gone(self) -> str:
        """Say that the folder was removed or replaced: another node may take the new one."""
        with contextlib.suppress(OSError):
            if self._handle is None or os.path.samestat(
                os.fstat(self._handle), self.path.stat()
            ):
                return ""
        return (
            f"state_folder: {self.path} was removed or replaced; start the node again"
        )

    def close(self) -> None:
        """Let others have the folder."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def next_name(folder: Path, kept: int, spared: Collection[str] = ()) -> Path:
    """Return a path in `folder`, such as 0001, without a suffix; its number is above all there.

    Of what is numbered there, all but the newest make room, so that `kept` are left with this one.

    Raises:
        OSError: the folder cannot be made or read.
    """
    make_folder(folder)
    keep_newest(folder, kept - 1, spared=spared)
    return folder / f"{max(numbered(folder).values(), default=0) + 1:04d}"


def keep_newest(
    folder: Path, count: int, prefix: str = "", spared: Collection[str] = ()
) -> None:
    """Remove files named by a prefix and a number but those with the `count` highest numbers.

    Others are left alone, and those whose names are `spared`.
    """
    with contextlib.suppress(OSError):  # a file more does no harm
        found = {
            path: number
            for path, number in numbered(folder, prefix).items()
            if path.name not in spared
        }
        kept = sorted(set(found.values()))[-count:]
        for path, number in found.items():
            if number not in kept:
                path.unlink()

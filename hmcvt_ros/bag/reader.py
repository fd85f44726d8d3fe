# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The messages of a rosbag2, read file by file, with every failure in words.

The topics of a bench have standard types, so the definitions that come with rosbags serve.
Definitions in the bag are not compiled: one that cannot be compiled, on a topic that is not read,
would otherwise close the whole bag (`AnyReader` of rosbags does).
"""

import shutil
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hmcvt_core import InputError

from .files import (
    COMPRESSED,
    METADATA,
    ZSTD_MAGIC,
    damage,
    files_of,
    reindex_hint,
    unfinished_journal,
)

NANOSECONDS = 1e-9

Record = tuple[str, float, Any]
"""Full name of the topic, time of receipt [s], and the message; None for unreadable bytes."""


@dataclass(frozen=True)
class _Part:
    """One open file of a bag: its path, and the reader of rosbags."""

    path: Path
    reader: Any


class Bag(ExitStack):
    """A bag open for reading; a context manager.

    A file that is empty, cut off or damaged is left out as long as another can be read, and
    `notes` name it.

    Args:
        path: folder of the bag, or one of its files (`.mcap`, `.db3`, also `.zstd` of them).

    Attributes:
        path: path as text, for messages.
        topics: full name -> type.
        counts: full name -> number of messages.
        notes: what is missing from the bag and how to recover it, as sentences.

    Raises:
        InputError: rosbags is not installed, the bag does not exist, or no file can be read.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__()
        self.path = str(path)
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        self.notes: list[str] = []
        self._types = _type_store()
        self._parts: list[_Part] = []
        self._problems: list[str] = []
        files = files_of(Path(path))
        self._metadata = files.metadata
        self.notes.extend(files.notes)
        try:
            self._open(files.paths)
            if not self._parts:
                missing = [f"{name} is missing" for name in files.missing]
                raise self._unreadable([*self._problems, *missing])
        except BaseException:
            self.close()
            raise
        self.notes.extend(f"{problem}: left out" for problem in self._problems)

    def records(self, topics: Collection[str]) -> Iterator[Record]:
        """Yield the messages of some topics in the order of the bag.

        Raises:
            InputError: no file can be read to its end, a type has another layout than in ROS 2
                Jazzy, or the messages are compressed in a way that cannot be read.
        """
        whole = 0
        chosen = 0
        for part in self._parts:
            connections = [
                entry for entry in part.reader.connections if entry.topic in topics
            ]
            if not connections:
                continue
            chosen += 1
            for entry in connections:
                self._require_known_layout(entry)
            try:
                for entry, receipt, data in part.reader.messages(connections):
                    message = self._decode(self._unpacked(data), entry.msgtype)
                    yield entry.topic, receipt * NANOSECONDS, message
            except (InputError, OSError):
                raise
            except Exception as error:  # its kind depends on storage and compression
                problem = damage(part.path, error)
                self._problems.append(problem)
                self.notes.append(f"{problem}: read as far as it goes")
            else:
                whole += 1
        if chosen and not whole:
            raise self._unreadable(self._problems)

    def matching(self, name: str, namespace: str | None = None) -> list[str]:
        """Return the topics that a name may mean: a full one, or its end in any namespace."""
        if name.startswith("/"):
            return [name] if name in self.topics else []
        if namespace is None:
            return sorted(
                topic for topic in self.topics if f"/{topic}".endswith(f"/{name}")
            )
        full = "/".join(part for part in (namespace.strip("/"), name) if part)
        return [topic for topic in self.topics if topic.lstrip("/") == full]

    # --- helpers ------------------------------------------------------------------------------

    def _open(self, paths: Collection[Path]) -> None:
        from rosbags.rosbag2 import Reader

        for path in paths:
            try:
                storage = self._readable_file(path)
                reader = self.enter_context(Reader(storage))
            except OSError:
                raise
            except Exception as error:  # its kind depends on the storage
                self._problems.append(damage(path, error))
                continue
            self._parts.append(_Part(path, reader))
            for entry in reader.connections:
                self.topics[entry.topic] = entry.msgtype
                count = self.counts.get(entry.topic, 0)
                self.counts[entry.topic] = count + entry.msgcount

    def _readable_file(self, path: Path) -> Path:
        """Return a file that rosbags can read: the file itself, or a copy in a temporary folder."""
        if path.suffix == COMPRESSED:
            return self._unpacked_file(path)
        journal = unfinished_journal(path)
        if journal is not None:
            return self._with_journal(path, journal)
        return path

    def _unpacked_file(self, path: Path) -> Path:
        folder = self.enter_context(TemporaryDirectory())
        unpacked = Path(folder, path.stem)
        with path.open("rb") as packed, unpacked.open("wb") as target:
            shutil.copyfileobj(_zstd().open(packed, "rb"), target)
        if self._metadata.problem:
            self.notes.append(f"{path.name} was unpacked for reading")
        return unpacked

    def _with_journal(self, path: Path, journal: Path) -> Path:
        """Copy a SQLite file and its journal, and write the journal into the copy."""
        folder = self.enter_context(TemporaryDirectory())
        for file in (path, journal):
            shutil.copy(file, folder)
        copy = Path(folder, path.name)
        with closing(sqlite3.connect(copy)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self.notes.append(
            f"{path.name} was not closed by the recorder: it was read together with "
            f"{journal.name}"
        )
        return copy

    def _unpacked(self, data: bytes) -> bytes:
        """Return the bytes of a message, unpacked where metadata.yaml says that they are packed."""
        if data[:4] != ZSTD_MAGIC:
            return data
        compression = self._metadata.message_compression
        if compression == "zstd":
            unpacked: bytes = _zstd().decompress(data)
            return unpacked
        if compression:
            raise InputError(
                f"{self.path}: the messages are compressed one by one by {compression}; "
                "only zstd can be read"
            )
        cure = "give the folder of the bag instead of one of its files"
        if Path(self.path).is_dir():
            cure = reindex_hint(Path(self.path))
        raise InputError(
            f"{self.path}: the messages are compressed one by one (zstd), and only "
            f"{METADATA} says so, which {self._metadata.problem or 'does not'}; {cure}"
        )

    def _require_known_layout(self, entry: Any) -> None:
        layout = entry.digest or self._metadata.layouts.get(entry.topic, "")
        known = entry.msgtype in self._types.fielddefs
        if known and layout:
            known = layout == self._types.hash_rihs01(entry.msgtype)
        if not known:
            raise InputError(
                f"{self.path}: {entry.topic} has type {entry.msgtype} with a layout that "
                "ROS 2 Jazzy does not know"
            )

    def _decode(self, data: bytes, kind: str) -> Any:
        try:
            return self._types.deserialize_cdr(data, kind)
        except Exception:  # of any kind: the bytes are no such message
            return None

    def _unreadable(self, problems: Collection[str]) -> InputError:
        return InputError(f"{self.path}: the bag cannot be read: {'; '.join(problems)}")


def _type_store() -> Any:
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(
            "reading bags needs the library rosbags; in the folder of hmcvt: "
            'pip install ".[bag]"'
        ) from error
    return get_typestore(Stores.ROS2_JAZZY)


def _zstd() -> Any:
    """Return the decompressor of rosbags: a package, or from Python 3.14 on a part of Python."""
    from rosbags.rosbag2 import reader

    return vars(reader)["zstd"]

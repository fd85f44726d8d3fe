# SPDX-License-Identifier: Apache-2.0
"""Messages of a rosbag2, with every failure in words.

The topics read here are of standard types, so the definitions that come with rosbags serve.
Definitions in the bag are not compiled: one that cannot be, on a topic nobody asked for, would
otherwise close the whole bag (`AnyReader` of rosbags does).
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from hmcvt_core import InputError

BAG_FILES = (".mcap", ".db3")
"""How the names of the files end that hold messages."""
_SHOWN = 12
_NANOSECONDS = 1e-9


class Bag:
    """A bag open for reading; a context manager.

    Args:
        path: folder of the bag, or one of its files (`.mcap`, `.db3`). A folder whose
            `metadata.yaml` was never written (the recorder was killed) is read file by file.

    Attributes:
        path: as text, for messages.
        topics: full name -> type.
        counts: full name -> number of messages.

    Raises:
        InputError: rosbags is not installed; the bag is missing, damaged or of another format.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = str(path)
        try:
            from rosbags.rosbag2 import Reader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise InputError("reading bags needs the library rosbags; in the folder of hmcvt: "
                             "pip install '.[bag]'") from error
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._stack = ExitStack()
        self._readers: list[Any] = []
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        try:
            for part in _parts(Path(path)):
                with self._in_words():
                    self._readers.append(self._stack.enter_context(Reader(part)))
        except BaseException:
            self._stack.close()
            raise
        for entry in itertools.chain.from_iterable(item.connections for item in self._readers):
            self.topics[entry.topic] = entry.msgtype
            self.counts[entry.topic] = self.counts.get(entry.topic, 0) + entry.msgcount

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def records(self, topics: Collection[str]) -> Iterator[tuple[str, float, Any]]:
        """Yield the messages of some topics in the order of the bag.

        Yields:
            Full name of the topic; when the recorder received the message [s]; the message with
            the fields of its type, None when the bytes are no such message.

        Raises:
            InputError: the bag is damaged, or a type has another layout than in ROS 2 Jazzy.
        """
        for reader in self._readers:
            chosen = [entry for entry in reader.connections if entry.topic in topics]
            for entry in chosen:
                known = entry.msgtype in self._types.fielddefs
                if not known or (
                        entry.digest and entry.digest != self._types.hash_rihs01(entry.msgtype)):
                    raise InputError(f"{self.path}: {entry.topic} has type {entry.msgtype} with a "
                                     "layout that ROS 2 Jazzy does not know")
            if chosen:
                with self._in_words():
                    for entry, receipt, data in reader.messages(connections=chosen):
                        message = self._decode(data, entry.msgtype)
                        yield entry.topic, receipt * _NANOSECONDS, message

    def describe_topics(self) -> str:
        """Return the topics with their types, for messages."""
        names = [f"{name} ({kind})" for name, kind in sorted(self.topics.items())]
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        return ", ".join(names[:_SHOWN]) + more if names else "none"

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            raise
        except Exception as error:
            # Each storage has errors of its own, decoders of compressed parts too.
            raise InputError(f"{self.path}: the bag cannot be read: "
                             f"{error or type(error).__name__}") from error

    def _decode(self, data: bytes, kind: str) -> Any:
        try:
            return self._types.deserialize_cdr(data, kind)
        except Exception:  # whatever the decoder stumbles on: the bytes are no such message
            return None


def _parts(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: there is no such bag")
    if not path.is_dir():
        if path.suffix not in BAG_FILES:
            raise InputError(f"{path}: a bag is a folder, or a file that ends in "
                             f"{' or '.join(BAG_FILES)}")
        return [path]
    if (path / "metadata.yaml").is_file():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix in BAG_FILES)
    if not files:
        raise InputError(f"{path}: is no bag: it holds neither metadata.yaml nor a file that "
                         f"ends in {' or '.join(BAG_FILES)}")
    return files

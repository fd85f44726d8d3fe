# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Messages of a rosbag2, with every failure in words: where to look for them, and reading them.

The topics read here are of standard types, so the definitions that come with rosbags serve.
Definitions in the bag are not compiled: one that cannot be, on a topic nobody asked for, would
otherwise close the whole bag (`AnyReader` of rosbags does).
"""

import itertools
import os
import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hmcvt_core import InputError
from hmcvt_core.files.steady import Shafts, Steadiness, limit, require_positive

BAG_FILES = (".mcap", ".db3")
"""How the names of the files end that hold messages."""
DISPLACEMENT_TOPIC = "displacement_ratio"
_INPUT_TOPICS = ("engine_speed", "load_torque", DISPLACEMENT_TOPIC)
_NUMERIC = r"std_msgs/msg/(Float|U?Int)\d+"
_SHOWN = 12
_NANOSECONDS = 1e-9


@dataclass(frozen=True)
class ImportSettings:
    """Where to look in a bag, and how.

    Attributes:
        topic: the topic with the shafts; the end of its name will do, unless it starts with `/`.
        namespace: of all topics; None takes the only one there is.
        steadiness: when a window counts as steady.
        age_limit, gap: see their metadata; a step back of the clock ends a window too.
        averaged: every message is a steady average already; no windows are sought.
        use_oil_temperature: whether to look for the oil temperature.
        signals: topic of numbers and size of their unit in SI, by field of `Shafts`, where no topic
            holds them all.

    Raises:
        InputError: a time is not positive, some signals are missing, or all have a topic too.
    """

    topic: str = "bench_sample"
    namespace: str | None = None
    steadiness: Steadiness = field(default_factory=Steadiness)
    age_limit: float = limit(
        5.0, "How far in s a reading of a slow topic may lie from a message."
    )
    gap: float = limit(1.0, "A longer pause between messages in s ends a window.")
    averaged: bool = False
    use_oil_temperature: bool = True
    signals: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_positive(self)
        missing = [name for name in Shafts._fields if name not in self.signals]
        if self.signals and missing:
            raise InputError(f"no topic is named for {', '.join(missing)}")
        if self.signals and self.topic != ImportSettings.topic:
            raise InputError(
                f"topic = {self.topic!r} holds all signals, or each has one of its "
                "own: name one or the other"
            )


@dataclass(frozen=True)
class Topics:
    """Full names of the topics to read.

    Attributes:
        bench: speeds and torques of the shafts, or the engine speed alone.
        signals: topic of numbers and size of their unit in SI, by field of `Shafts`: all of them,
            or the displacement ratio for messages on `bench` without the joint `displacement`.
        oil_temperature: or None.
        notes: what was found and not used, in sentences.
    """

    bench: str
    signals: Mapping[str, tuple[str, float]]
    oil_temperature: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def apart(self) -> bool:
        """Whether each signal has a topic of its own."""
        return "engine_speed" in self.signals

    @property
    def names(self) -> tuple[str, ...]:
        """All of them."""
        found = [self.bench, *(topic for topic, _ in self.signals.values())]
        return tuple(dict.fromkeys([*found, *filter(None, [self.oil_temperature])]))


class Bag(ExitStack):
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
        super().__init__()
        self.path = str(path)
        try:
            from rosbags.rosbag2 import Reader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise InputError(
                "reading bags needs the library rosbags; in the folder of hmcvt: "
                'pip install ".[bag]"'
            ) from error
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._readers: list[Any] = []
        self.topics: dict[str, str] = {}
        self.counts: dict[str, int] = {}
        try:
            for part in _parts(Path(path)):
                with self._in_words():
                    self._readers.append(self.enter_context(Reader(part)))
        except BaseException:
            self.close()
            raise
        for entry in itertools.chain.from_iterable(
            item.connections for item in self._readers
        ):
            self.topics[entry.topic] = entry.msgtype
            self.counts[entry.topic] = self.counts.get(entry.topic, 0) + entry.msgcount

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
                    entry.digest
                    and entry.digest != self._types.hash_rihs01(entry.msgtype)
                ):
                    raise InputError(
                        f"{self.path}: {entry.topic} has type {entry.msgtype} with a "
                        "layout that ROS 2 Jazzy does not know"
                    )
            if chosen:
                with self._in_words():
                    for entry, receipt, data in reader.messages(connections=chosen):
                        message = self._decode(data, entry.msgtype)
                        yield entry.topic, receipt * _NANOSECONDS, message

    def matching(self, name: str, namespace: str | None = None) -> list[str]:
        """Return the topics that a name may mean: a full one, or its end in any namespace."""
        if name.startswith("/"):
            return [name] if name in self.topics else []
        if namespace is None:
            return sorted(
                topic for topic in self.topics if f"/{topic}".endswith(f"/{name}")
            )
        full = "/".join(part for part in ("", namespace.strip("/"), name) if part)
        return [topic for topic in self.topics if topic.lstrip("/") == full]

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        try:
            yield
        except OSError:
            raise
        except Exception as error:
            # Each storage has errors of its own, decoders of compressed parts too.
            raise InputError(
                f"{self.path}: the bag cannot be read: {error or type(error).__name__}"
            ) from error

    def _decode(self, data: bytes, kind: str) -> Any:
        try:
            return self._types.deserialize_cdr(data, kind)
        except (
            Exception
        ):  # whatever the decoder stumbles on: the bytes are no such message
            return None


def find_topics(bag: Bag, settings: ImportSettings) -> Topics:
    """Find the topics by the end of their names.

    Raises:
        InputError: the topic of the shafts is missing, there are several, or its type is another;
            the topics in the bag are named.
    """
    signals = {
        name: (_topic(bag, topic, settings.namespace, _NUMERIC, "a number"), size)
        for name, (topic, size) in settings.signals.items()
    }
    if len({topic for topic, _ in signals.values()}) < len(signals):
        raise InputError(f"{bag.path}: two signals name the same topic")
    bench = (
        signals["engine_speed"][0]
        if signals
        else _topic(
            bag, settings.topic, settings.namespace, ".*/JointState", "JointState"
        )
    )
    notes: list[str] = []

    def beside(name: str, kind: str) -> str | None:
        """The one topic of a name, the one beside that of the shafts first."""
        found = bag.matching(name, settings.namespace)
        nearest = f"{bench.rpartition('/')[0]}/{name}"
        first = nearest if nearest in found else next(iter(found), None)
        if len(found) > 1 and first != nearest:
            notes.append(f"{' and '.join(found)}: none used; choose one by --namespace")
        elif first is not None and not bag.topics[first].endswith(f"/{kind}"):
            notes.append(f"{first} is {bag.topics[first]}, not {kind}: not used")
        else:
            return first
        return None

    if not signals and (stroke := beside(DISPLACEMENT_TOPIC, "Float64")):
        signals = {DISPLACEMENT_TOPIC: (stroke, 1.0)}
    warmth = (
        beside("oil_temperature", "Temperature")
        if settings.use_oil_temperature
        else None
    )
    return Topics(bench, signals, warmth, tuple(notes))


def _topic(bag: Bag, name: str, namespace: str | None, kind: str, told: str) -> str:
    """The one topic that a name means, with messages of a kind, a regular expression."""
    found = bag.matching(name, namespace)
    if len(found) > 1:
        raise InputError(
            f"{bag.path}: holds {' and '.join(found)}; choose one by --namespace "
            "or its full name"
        )
    if not found:
        where = (
            ""
            if namespace is None or name.startswith("/")
            else f" in namespace {namespace}"
        )
        held = ", ".join(each for each in _INPUT_TOPICS if bag.matching(each))
        hint = (
            (
                f" ({held} alone cannot give a measured efficiency: that takes speed and torque of "
                "both shafts)"
            )
            if held
            else ""
        )
        problem = f"holds no topic {name}{where}{hint}"
    elif not re.fullmatch(kind, bag.topics[found[0]]):
        problem = f"{found[0]} is {bag.topics[found[0]]}, not {told}"
    elif not bag.counts[found[0]]:
        problem = f"{found[0]} holds no messages"
    else:
        return found[0]
    names = [f"{topic} ({type_})" for topic, type_ in sorted(bag.topics.items())]
    shown = ", ".join(names[:_SHOWN]) or "none"
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    raise InputError(f"{bag.path}: {problem}; topics in it: {shown}{more}")


def _parts(path: Path) -> list[Path]:
    if not path.exists():
        raise InputError(f"{path}: there is no such bag")
    if not path.is_dir():
        if path.suffix not in BAG_FILES:
            raise InputError(
                f"{path}: a bag is a folder, or a file that ends in "
                f"{' or '.join(BAG_FILES)}"
            )
        return [path]
    if (path / "metadata.yaml").is_file():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix in BAG_FILES)
    if not files:
        raise InputError(
            f"{path}: is no bag: it holds neither metadata.yaml nor a file that "
            f"ends in {' or '.join(BAG_FILES)}"
        )
    return files

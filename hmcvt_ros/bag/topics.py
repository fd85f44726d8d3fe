# SPDX-License-Identifier: Apache-2.0
"""Where to look in a bag: settings, and the topics to read."""

from __future__ import annotations

from dataclasses import dataclass, field

from hmcvt_core import InputError

from .reader import Bag
from .steady import Steadiness, require_positive

DISPLACEMENT_TOPIC = "displacement_ratio"
TEMPERATURE_TOPIC = "oil_temperature"
_INPUT_TOPICS = ("engine_speed", "load_torque", DISPLACEMENT_TOPIC)


@dataclass(frozen=True)
class ImportSettings:
    """Where to look in a bag, and how.

    Attributes:
        topic: the topic with the shafts; the end of its name will do, unless it starts with `/`.
        namespace: of all topics; None takes the only one there is.
        steadiness: when a window counts as steady.
        age_limit: how far in time a reading of a slow channel may lie from a message [s].
        gap: a longer pause between messages, or a step back of the clock, ends a window [s].
        averaged: every message is a steady average already; no windows are sought.
        use_oil_temperature: whether to look for the oil temperature.

    Raises:
        InputError: a time is not positive.
    """

    topic: str = "bench_sample"
    namespace: str | None = None
    steadiness: Steadiness = field(default_factory=Steadiness)
    age_limit: float = 5.0
    gap: float = 1.0
    averaged: bool = False
    use_oil_temperature: bool = True

    def __post_init__(self) -> None:
        require_positive("age_limit", self.age_limit)
        require_positive("gap", self.gap)


@dataclass(frozen=True)
class Topics:
    """Full names of the topics to read.

    Attributes:
        bench: speeds and torques of the shafts.
        displacement_ratio: for messages on `bench` without the joint `displacement`, or None.
        oil_temperature: or None.
        notes: what was found and not used, in sentences.
    """

    bench: str
    displacement_ratio: str | None = None
    oil_temperature: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All of them."""
        found = (self.bench, self.displacement_ratio, self.oil_temperature)
        return tuple(name for name in found if name is not None)


def find_topics(bag: Bag, settings: ImportSettings) -> Topics:
    """Find the topics by the end of their names.

    Raises:
        InputError: the topic of the shafts is missing, there are several, or its type is another;
            the topics in the bag are named.
    """
    bench = _bench_topic(bag, settings)
    notes: list[str] = []

    def beside(name: str, kind: str) -> str | None:
        """The one topic of a name, the one beside that of the shafts first."""
        found = _matching(bag, name, settings.namespace)
        nearest = f"{bench.rpartition('/')[0]}/{name}"
        first = nearest if nearest in found else next(iter(found), None)
        if len(found) > 1 and first != nearest:
            notes.append(f"{' and '.join(found)}: none used; choose one by --namespace")
        elif first is not None and not bag.topics[first].endswith(f"/{kind}"):
            notes.append(f"{first} is {bag.topics[first]}, not {kind}: not used")
        else:
            return first
        return None

    stroke = beside(DISPLACEMENT_TOPIC, "Float64")
    warmth = beside(TEMPERATURE_TOPIC, "Temperature") if settings.use_oil_temperature else None
    return Topics(bench, stroke, warmth, tuple(notes))


def _bench_topic(bag: Bag, settings: ImportSettings) -> str:
    found = _matching(bag, settings.topic, settings.namespace)
    if len(found) > 1:
        raise InputError(f"{bag.path}: holds {' and '.join(found)}; choose one by --namespace "
                         "or its full name")
    if not found:
        where = "" if settings.namespace is None or settings.topic.startswith("/") else (
            f" in namespace {settings.namespace}")
        held = ", ".join(name for name in _INPUT_TOPICS if _matching(bag, name, None))
        hint = (f" ({held} alone cannot give a measured efficiency: that takes speed and torque of "
                "both shafts)") if held else ""
        problem = f"holds no topic {settings.topic}{where}{hint}"
    elif not bag.topics[found[0]].endswith("/JointState"):
        problem = f"{found[0]} is {bag.topics[found[0]]}, not JointState"
    elif not bag.counts[found[0]]:
        problem = f"{found[0]} holds no messages"
    else:
        return found[0]
    raise InputError(f"{bag.path}: {problem}; topics in it: {bag.describe_topics()}")


def _matching(bag: Bag, name: str, namespace: str | None) -> list[str]:
    if name.startswith("/"):
        return [name] if name in bag.topics else []
    if namespace is None:
        return sorted(topic for topic in bag.topics if f"/{topic}".endswith(f"/{name}"))
    full = "/".join(part for part in ("", namespace.strip("/"), name) if part)
    return [topic for topic in bag.topics if topic.lstrip("/") == full]

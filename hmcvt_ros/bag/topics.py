# SPDX-License-Identifier: Apache-2.0
"""Which topics of a bag to read."""

from __future__ import annotations

from dataclasses import dataclass

from hmcvt_core import InputError

from .reader import Bag
from .settings import ImportSettings

DISPLACEMENT_TOPIC = "displacement_ratio"
TEMPERATURE_TOPIC = "oil_temperature"
_INPUT_TOPICS = ("engine_speed", "load_torque", DISPLACEMENT_TOPIC)
_BENCH_TYPE, _NUMBER_TYPE, _TEMPERATURE_TYPE = "JointState", "Float64", "Temperature"


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
    displacement = _side_topic(bag, settings, bench, DISPLACEMENT_TOPIC, _NUMBER_TYPE, notes)
    temperature = None
    if settings.use_oil_temperature:
        temperature = _side_topic(
            bag, settings, bench, TEMPERATURE_TOPIC, _TEMPERATURE_TYPE, notes)
    return Topics(bench, displacement, temperature, tuple(notes))


def _bench_topic(bag: Bag, settings: ImportSettings) -> str:
    found = _matching(bag, settings.topic, settings.namespace)
    if not found:
        raise InputError(f"{bag.path}: holds no topic {_wanted(settings)}{_inputs_only(bag)}; "
                         f"topics in it: {bag.describe_topics()}")
    if len(found) > 1:
        raise InputError(f"{bag.path}: holds {' and '.join(found)}; choose one by --namespace "
                         "or its full name")
    kind = bag.topics[found[0]]
    if not _is(kind, _BENCH_TYPE):
        raise InputError(f"{bag.path}: {found[0]} is {kind}, not {_BENCH_TYPE}; "
                         f"topics in it: {bag.describe_topics()}")
    if not bag.counts[found[0]]:
        raise InputError(f"{bag.path}: {found[0]} holds no messages; "
                         f"topics in it: {bag.describe_topics()}")
    return found[0]


def _side_topic(
    bag: Bag, settings: ImportSettings, bench: str, name: str, kind: str, notes: list[str]
) -> str | None:
    found = _matching(bag, name, settings.namespace)
    beside = f"{bench.rpartition('/')[0]}/{name}"
    if beside in found:
        found = [beside]
    if len(found) > 1:
        notes.append(f"{' and '.join(found)}: none used; choose one by --namespace")
        return None
    if found and not _is(bag.topics[found[0]], kind):
        notes.append(f"{found[0]} is {bag.topics[found[0]]}, not {kind}: not used")
        return None
    return found[0] if found else None


def _matching(bag: Bag, name: str, namespace: str | None) -> list[str]:
    if name.startswith("/"):
        return [name] if name in bag.topics else []
    if namespace is None:
        return sorted(topic for topic in bag.topics if f"/{topic}".endswith(f"/{name}"))
    full = "/".join(part for part in ("", namespace.strip("/"), name) if part)
    return [topic for topic in bag.topics if topic.lstrip("/") == full]


def _wanted(settings: ImportSettings) -> str:
    if settings.namespace is None or settings.topic.startswith("/"):
        return settings.topic
    return f"{settings.topic} in namespace {settings.namespace}"


def _inputs_only(bag: Bag) -> str:
    held = [name for name in _INPUT_TOPICS if _matching(bag, name, None)]
    if not held:
        return ""
    return (f" ({', '.join(held)} alone cannot give a measured efficiency: that takes speed and "
            "torque of both shafts)")


def _is(kind: str, name: str) -> bool:
    return kind.rpartition("/")[2] == name

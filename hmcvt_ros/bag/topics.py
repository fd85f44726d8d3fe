# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which topics of a bag hold the readings, by the end of their names."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from hmcvt_core import InputError

from .reader import Bag
from .settings import ImportSettings

DISPLACEMENT_TOPIC = "displacement_ratio"
OIL_TEMPERATURE_TOPIC = "oil_temperature"
STAGE_TOPIC = "stage"

_INPUT_TOPICS = ("engine_speed", "load_torque", DISPLACEMENT_TOPIC)
_NUMBER = r"std_msgs/msg/(Float|U?Int)\d+"
_JOINT_STATE = ".*/JointState"
_SHOWN = 12
"""Topics of the bag that a message lists."""


@dataclass(frozen=True)
class Topics:
    """Full names of the topics to read.

    Attributes:
        bench: topic with speeds and torques of the shafts, or with the engine speed alone.
        signals: topic of numbers and size of their unit in SI, by field of `Shafts`: all of them,
            or the displacement ratio for messages on `bench` without the joint `displacement`.
        oil_temperature: topic of the oil temperature, or None.
        stage: topic of the stage engaged, or None.
        notes: topics that look right and are not used, as sentences.
    """

    bench: str
    signals: Mapping[str, tuple[str, float]]
    oil_temperature: str | None = None
    stage: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def apart(self) -> bool:
        """Whether each signal has a topic of its own."""
        return "engine_speed" in self.signals

    @property
    def names(self) -> tuple[str, ...]:
        """All topics."""
        signals = [topic for topic, _ in self.signals.values()]
        optional = [
            topic for topic in (self.oil_temperature, self.stage) if topic is not None
        ]
        return tuple(dict.fromkeys([self.bench, *signals, *optional]))


def find_topics(bag: Bag, settings: ImportSettings) -> Topics:
    """Find the topics by the end of their names.

    Raises:
        InputError: the topic of the shafts is missing, ambiguous or of another type; the message
            lists the topics in the bag.
    """
    signals = {}
    for name, (topic, size) in settings.signals.items():
        full_name = _required(bag, topic, settings.namespace, _NUMBER, "a number")
        signals[name] = (full_name, size)
    if len({topic for topic, _ in signals.values()}) < len(signals):
        raise InputError(f"{bag.path}: two signals name the same topic")
    if signals:
        bench = signals["engine_speed"][0]
    else:
        bench = _required(
            bag, settings.topic, settings.namespace, _JOINT_STATE, "JointState"
        )
    companions = _Companions(bag, bench, settings.namespace)
    if not signals and (stroke := companions.find(DISPLACEMENT_TOPIC, "Float64")):
        signals = {DISPLACEMENT_TOPIC: (stroke, 1.0)}
    temperature = None
    if settings.use_oil_temperature:
        temperature = companions.find(OIL_TEMPERATURE_TOPIC, "Temperature")
    stage = None
    if settings.use_stage:
        stage = companions.find(STAGE_TOPIC, "String")
    return Topics(bench, signals, temperature, stage, tuple(companions.notes))


class _Companions:
    """Finds optional topics, those in the namespace of the bench topic first."""

    def __init__(self, bag: Bag, bench: str, namespace: str | None) -> None:
        self.notes: list[str] = []
        self._bag = bag
        self._prefix = bench.rpartition("/")[0]
        self._namespace = namespace

    def find(self, name: str, kind: str) -> str | None:
        """Return the topic of a name with messages of a type, None with a note if unsuitable."""
        candidates = self._bag.matching(name, self._namespace)
        if not candidates:
            return None
        topic = f"{self._prefix}/{name}"
        if topic not in candidates:
            if len(candidates) > 1:
                self.notes.append(
                    f"{' and '.join(candidates)}: none used; choose one by --namespace"
                )
                return None
            topic = candidates[0]
        actual = self._bag.topics[topic]
        if not actual.endswith(f"/{kind}"):
            self.notes.append(f"{topic} is {actual}, not {kind}: not used")
            return None
        return topic


def _required(
    bag: Bag, name: str, namespace: str | None, kind: str, kind_in_words: str
) -> str:
    """Return the one topic that a name means, whose type matches a regular expression."""
    candidates = bag.matching(name, namespace)
    if len(candidates) > 1:
        raise InputError(
            f"{bag.path}: holds {' and '.join(candidates)}; choose one by --namespace "
            "or its full name"
        )
    if not candidates:
        raise _refusal(bag, _missing(bag, name, namespace))
    topic = candidates[0]
    if not re.fullmatch(kind, bag.topics[topic]):
        raise _refusal(bag, f"{topic} is {bag.topics[topic]}, not {kind_in_words}")
    if not bag.counts[topic]:
        raise _refusal(bag, f"{topic} holds no messages")
    return topic


def _missing(bag: Bag, name: str, namespace: str | None) -> str:
    where = ""
    if namespace is not None and not name.startswith("/"):
        where = f" in namespace {namespace}"
    inputs = [topic for topic in _INPUT_TOPICS if bag.matching(topic)]
    hint = ""
    if inputs:
        hint = (
            f" ({', '.join(inputs)} alone cannot give a measured efficiency: that takes "
            "speed and torque of both shafts)"
        )
    return f"holds no topic {name}{where}{hint}"


def _refusal(bag: Bag, problem: str) -> InputError:
    names = [f"{topic} ({kind})" for topic, kind in sorted(bag.topics.items())]
    listed = ", ".join(names[:_SHOWN]) or "none"
    if len(names) > _SHOWN:
        listed = f"{listed} and {len(names) - _SHOWN} more"
    notes = "".join(f"; {note}" for note in bag.notes)
    return InputError(f"{bag.path}: {problem}; topics in it: {listed}{notes}")

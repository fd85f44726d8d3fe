# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A client of the node that knows nothing of ROS: Eclipse Cyclone DDS, another DDS than the node's.

    python cyclone_client.py DOMAIN NAMESPACE < points and a bench sample as JSON > answers as JSON

It names topics and types as ROS 2 does on the wire (design.ros2.org, "Topic and Service name
mapping to DDS") and takes them from no file of this project or of ROS.
"""

# No `from __future__ import annotations`: Cyclone reads the types of the fields at run time.

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

# To itself and to ROS with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST.
LOOPBACK = """<CycloneDDS><Domain>
  <General><AllowMulticast>false</AllowMulticast>
    <Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex>
    <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""
RELIABLE = Policy.Reliability.Reliable(duration(seconds=1))
PATIENCE = 20.0
INPUTS = ("displacement_ratio", "engine_speed", "load_torque")


@dataclass
class Float64(IdlStruct, typename="std_msgs::msg::dds_::Float64_"):
    data: float64


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


class Client:
    """Readers and writers on the topics of one node."""

    def __init__(self, participant: DomainParticipant, namespace: str) -> None:
        def topic(name: str, kind: Any) -> Topic:
            return Topic(participant, f"rt{namespace}/{name}", kind)

        volatile = Qos(RELIABLE, Policy.History.KeepLast(100),
                       Policy.DataRepresentation(use_cdrv0_representation=True))
        latched = Qos(RELIABLE, Policy.History.KeepLast(1), Policy.Durability.TransientLocal,
                      Policy.DataRepresentation(use_cdrv0_representation=True))
        self._inputs = [DataWriter(participant, topic(name, Float64), qos=volatile)
                        for name in INPUTS]
        self._samples = DataWriter(participant, topic("bench_sample", JointState), qos=volatile)
        self._efficiency, self._optimum = (
            DataReader(participant, topic(name, Float64), qos=volatile)
            for name in ("efficiency", "optimal_displacement_ratio"))
        self._model = DataReader(participant, topic("hmcvt/model", String), qos=latched)

    def model(self) -> str:
        """Return the model in service, which the node has published before this client began."""
        found: list[String] = []

        def heard() -> bool:
            found.extend(self._model.take(1))
            return bool(found)

        _until(heard)
        return found[0].data

    def ask(self, point: list[float]) -> list[float]:
        """Hold an operating point until there are answers to it; return the last ones."""
        answers: list[list[float]] = [[], []]
        rounds = 0

        def answered() -> bool:
            nonlocal rounds
            for writer, value in zip(self._inputs, point, strict=True):
                writer.write(Float64(value))
            time.sleep(0.1)
            for found, reader in zip(answers, (self._efficiency, self._optimum), strict=True):
                found += [sample.data for sample in reader.take(100)]
            rounds += 1
            return rounds >= 5 and all(answers)

        _until(answered)
        return [found[-1] for found in answers]

    def send_sample(self, sample: dict[str, Any]) -> None:
        """Send a bench sample, once the node listens."""
        _until(lambda: self._samples.get_matched_subscriptions())
        self._samples.write(JointState(header=Header(), **sample))
        self._samples.wait_for_acks(duration(seconds=PATIENCE))


def _until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            sys.exit("cyclone_client: the node does not answer")
        time.sleep(0.02)


def main() -> None:
    number, namespace = int(sys.argv[1]), sys.argv[2]
    given = json.load(sys.stdin)
    domain = Domain(number, LOOPBACK)  # noqa: F841 (lives as long as the client)
    client = Client(DomainParticipant(number), namespace)
    model = client.model()
    answers = [client.ask(point) for point in given["points"]]
    client.send_sample(given["sample"])
    json.dump({"model": model, "answers": answers,
               "ros": any(name.startswith(("rclpy", "hmcvt")) for name in sys.modules)}, sys.stdout)


if __name__ == "__main__":
    main()

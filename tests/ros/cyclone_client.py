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
from dataclasses import dataclass, field

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
COMMON = (
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepLast(100),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)
VOLATILE, LATCHED = Qos(*COMMON), Qos(*COMMON, Policy.Durability.TransientLocal)
PATIENCE = 20.0


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


def until(found):
    """Wait for a true value and return it."""
    end = time.monotonic() + PATIENCE
    while not (value := found()):
        if time.monotonic() > end:
            sys.exit("cyclone_client: the node does not answer")
        time.sleep(0.02)
    return value


def ask(point, inputs, outputs):
    """Hold an operating point until there are answers to it; return the last ones."""
    heard = [[] for _ in outputs]
    for i in range(int(PATIENCE / 0.1)):
        for writer, value in zip(inputs, point, strict=True):
            writer.write(Float64(value))
        time.sleep(0.1)
        for values, reader in zip(heard, outputs, strict=True):
            values += [sample.data for sample in reader.take(100)]
        if i >= 4 and all(heard):
            return [values[-1] for values in heard]
    sys.exit("cyclone_client: the node does not answer")


number, namespace = int(sys.argv[1]), sys.argv[2]
given = json.load(sys.stdin)
domain = Domain(number, LOOPBACK)  # lives as long as the client
participant = DomainParticipant(number)


def end(kind, name, data, qos=VOLATILE):
    """A reader or a writer on a topic of the node."""
    return kind(participant, Topic(participant, f"rt{namespace}/{name}", data), qos=qos)


inputs = [
    end(DataWriter, name, Float64)
    for name in ("displacement_ratio", "engine_speed", "load_torque")
]
outputs = [
    end(DataReader, name, Float64)
    for name in ("efficiency", "optimal_displacement_ratio")
]
samples = end(DataWriter, "bench_sample", JointState)
latched = end(DataReader, "hmcvt/model", String, LATCHED)
# The model in service, which the node has published before this client began.
model = until(lambda: latched.take(1))[0].data
answers = [ask(point, inputs, outputs) for point in given["points"]]
until(samples.get_matched_subscriptions)
samples.write(JointState(header=Header(), **given["sample"]))
samples.wait_for_acks(duration(seconds=PATIENCE))
json.dump(
    {
        "model": model,
        "answers": answers,
        "ros": any(name.startswith(("rclpy", "hmcvt")) for name in sys.modules),
    },
    sys.stdout,
)

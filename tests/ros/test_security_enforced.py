# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The shipped SROS2 policy, enforced by a DDS that has security.

The DDS of the ROS wheels has none, so the node itself cannot take part: participants with the
topics and services of the node and of its clients stand in for them. Each tries to write and to
read every one of them.
"""

import glob
import os
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from dds_security import Keystore, build, full, rules, settings, wire_names

import hmcvt_ros

PLUGINS = sorted(glob.glob("/usr/lib/*/libddsc0debian"))
POLICY = Path(hmcvt_ros.__file__).parent / "security" / "hmcvt.policy.xml"
PROFILES = {
    item.get("node"): item for item in ElementTree.parse(POLICY).iter("profile")
}
CLIENTS = ["bench_player", "control_stack", "listener"]
# `stranger` has an identity of this keystore and no permission here; `anybody` has none.
ROLES = ["hmcvt", *CLIENTS, "stranger", "anybody"]
SECONDS = 8

# Who may write each topic, and who may call each service, besides the node; told here anew.
MAY_WRITE = {
    "displacement_ratio": {"bench_player", "control_stack"},
    "engine_speed": {"bench_player", "control_stack"},
    "load_torque": {"bench_player", "control_stack"},
    "oil_temperature": {"bench_player", "control_stack"},
    "operating_point": {"bench_player", "control_stack"},
    "stage": {"bench_player", "control_stack"},
    "session": {"bench_player"},
    "bench_sample": {"bench_player"},
    "clock": set(),
}
ANSWERS = {
    "efficiency",
    "optimal_displacement_ratio",
    "optimal_engine_speed",
    "optimal_stage",
    "advice",
    "hmcvt/model",
    "hmcvt/efficiency_map",
    "diagnostics",
    "hmcvt/progress",
}
LOGS = {"rosout", "parameter_events"}
MAY_CALL = {
    f"hmcvt/{name}": {"bench_player"}
    for name in ("reidentify", "adopt", "diagnose", "revert", "clear_samples", "cancel")
}
OF_EVERY_NODE = {
    f"hmcvt/{name}"
    for name in (
        "describe_parameters",
        "get_parameter_types",
        "get_parameters",
        "list_parameters",
        "set_parameters",
        "set_parameters_atomically",
        "get_type_description",
        "get_logger_levels",
        "set_logger_levels",
    )
}

pytestmark = pytest.mark.skipif(
    not (PLUGINS and all(map(shutil.which, ("idlc", "cc", "openssl")))),
    reason="needs Cyclone DDS with security: apt-get install cyclonedds-dev cyclonedds-tools gcc",
)


def names(tag):
    """The topics or the services of the node, without the first slash."""
    return sorted(full(item.text, "hmcvt")[1:] for item in PROFILES["hmcvt"].iter(tag))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What became of every end: by role and end, (`allowed` or `refused`, roles heard)."""
    # Where no node is, nor those of tests that run side by side with this one.
    domain = 1 + (int(os.environ["ROS_DOMAIN_ID"]) + 50) % 101
    folder = tmp_path_factory.mktemp("keystore")
    keystore, program = Keystore(folder, domain), build(folder)
    ends = [
        f"{end}{name}"
        for tag in ("topic", "service")
        for ros_name in names(tag)
        for name in wire_names(tag, f"/{ros_name}")
        for end in "wr"
    ]

    def start(number, role):
        if role == "anybody":
            configuration = settings()
        else:
            permitted = (
                rules(PROFILES[role]) if role in PROFILES else ({"rt/chatter"},) * 2
            )
            configuration = keystore.enclave(f"/{role}", *permitted)
        environment = {
            **os.environ,
            "CYCLONEDDS_URI": configuration,
            "LD_LIBRARY_PATH": PLUGINS[0],
        }
        return subprocess.Popen(
            [program, str(domain), str(SECONDS), str(number), *ends],
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )

    running = {role: start(number, role) for number, role in enumerate(ROLES)}
    table = {}
    for role, process in running.items():
        for line in process.communicate(timeout=60)[0].splitlines():
            end, verdict, *heard = line.split()
            table[role, end] = verdict, {ROLES[int(number)] for number in heard}
    assert len(table) == len(ROLES) * len(ends)
    return table


def able(found, end):
    """Roles with an identity that may write (`w` before the name) or read (`r`)."""
    return {role for role in ROLES[:-1] if found[role, end][0] == "allowed"}


def check_heard(found, name):
    """Who may read hears who may write and nobody else; who has no identity, only itself."""
    for role in able(found, f"r{name}"):
        assert found[role, f"r{name}"][1] == able(found, f"w{name}"), (role, name)
    assert found["anybody", f"r{name}"] == ("allowed", {"anybody"})


@pytest.mark.parametrize("name", names("topic"))
def test_topic(found, name):
    (topic,) = wire_names("topic", f"/{name}")
    if name in LOGS:
        # Every node writes it; the policy lets nobody read it here.
        assert able(found, f"w{topic}") == {"hmcvt", *CLIENTS} and not able(
            found, f"r{topic}"
        )
    elif name in ANSWERS:
        assert able(found, f"w{topic}") == {"hmcvt"}
        assert able(found, f"r{topic}") == set(CLIENTS)
    else:
        assert able(found, f"w{topic}") == MAY_WRITE[name]
        assert "hmcvt" in able(found, f"r{topic}") and "stranger" not in able(
            found, f"r{topic}"
        )
    check_heard(found, topic)


@pytest.mark.parametrize("name", names("service"))
def test_service(found, name):
    request, reply = wire_names("service", f"/{name}")
    callers = set() if name in OF_EVERY_NODE else MAY_CALL[name]
    assert able(found, f"w{request}") == callers and able(found, f"r{request}") == {
        "hmcvt"
    }
    assert able(found, f"w{reply}") == {"hmcvt"} and able(found, f"r{reply}") == callers
    check_heard(found, request)
    check_heard(found, reply)


def test_every_topic_and_service_has_been_tried():
    assert set(names("topic")) == MAY_WRITE.keys() | ANSWERS | LOGS
    assert set(names("service")) == MAY_CALL.keys() | OF_EVERY_NODE

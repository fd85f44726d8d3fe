# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The SROS2 policy that ships, against what a running node and its client really use."""

import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from dds_security import full
from rclpy.node import NodeNameNonExistentError
from ros_bench import command

import hmcvt_ros

PLACE = Path(hmcvt_ros.__file__).parent
POLICY = ElementTree.parse(PLACE / "security" / "hmcvt.policy.xml")
EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "control_stack.py"
# (element, attribute, value): the query of the graph that tells what a node uses in this way.
QUERIES = {
    ("topics", "publish"): "get_publisher_names_and_types_by_node",
    ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
    ("services", "reply"): "get_service_names_and_types_by_node",
    ("services", "request"): "get_client_names_and_types_by_node",
}


def allowed(node, namespace):
    """What the policy allows a node, by the kinds of `QUERIES`; names stand once."""
    (profile,) = POLICY.iterfind(f"enclaves/enclave/profiles/profile[@node='{node}']")
    found = {kind: [] for kind in QUERIES}
    for group in profile:
        ((verb, rule),) = group.attrib.items()
        assert rule == "ALLOW"
        found[group.tag, verb] += [full(item.text, node, namespace) for item in group]
    return {kind: sorted(names) for kind, names in found.items()}


def used(observer, node, namespace):
    """What a running node uses, as another node sees it; nothing before it is discovered."""
    try:
        return {
            kind: sorted(name for name, _ in getattr(observer, query)(node, namespace))
            for kind, query in QUERIES.items()
        }
    except NodeNameNonExistentError:
        return {}


def test_policy_allows_what_the_node_uses_and_nothing_else(sim_node, connect):
    observer = connect("/observer")
    namespace = sim_node.namespace  # it subscribes to /clock
    assert observer.wait_until(
        lambda: used(observer, "hmcvt", namespace) == allowed("hmcvt", namespace), 10.0
    ), (used(observer, "hmcvt", namespace), allowed("hmcvt", namespace))


@pytest.fixture
def control_stack(sim_node, environment):
    """The example of a controller, which pretends to be the tractor too."""
    with subprocess.Popen(
        [sys.executable, str(EXAMPLE), "--pretend", "--namespace", sim_node.namespace],
        env={**environment, "PYTHONPATH": str(PLACE.parent)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        yield
        process.kill()


@pytest.mark.parametrize("name", ["bench_player", "control_stack"])
def test_policy_allows_a_client_what_it_uses(sim_node, connect, control_stack, name):
    observer, rules = connect("/observer"), allowed(name, sim_node.namespace)

    def permitted():
        found = used(observer, name, sim_node.namespace)
        return (
            found
            and all(set(found[kind]) <= set(rules[kind]) for kind in QUERIES)
            and all(found[kind] for kind in QUERIES if rules[kind])
        )

    assert observer.wait_until(permitted, 15.0), (
        used(observer, name, sim_node.namespace),
        rules,
    )


def test_policy_has_the_form_that_sros2_reads():
    root = POLICY.getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    assert [enclave.get("path") for enclave in root.iterfind("enclaves/enclave")] == [
        "/hmcvt",
        "/bench_player",
        "/control_stack",
        "/listener",
    ]
    for profile in root.iter("profile"):
        assert profile.attrib == {"ns": "/", "node": profile.get("node")}
        assert {child.tag for group in profile for child in group} == {
            "topic",
            "service",
        }


def test_node_does_not_run_unprotected_where_protection_is_asked_for(
    environment, tmp_path
):
    # The DDS of the wheels has no security; where it has, the keystore is empty.
    (tmp_path / "enclaves").mkdir()
    asked = {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path),
    }
    result = subprocess.run(
        command(f"state_folder:={tmp_path}"),
        env={**environment, **asked},
        capture_output=True,
        text=True,
        timeout=20,
    )
    assert result.returncode == 2
    assert "hmcvt: error: " in result.stderr and "serving" not in result.stderr

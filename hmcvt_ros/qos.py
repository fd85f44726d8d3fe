# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Quality of service of every topic; reliability and depth can be overridden by parameter."""

import copy
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

# Best effort also hears reliable publishers; a reliable subscription would miss best-effort ones.
# No deadline: a subscription that asks for one refuses every publisher that offers none.
INPUT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)

# Bench samples come in bursts, and none may be lost.
BENCH_SAMPLE = QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)

OUTPUT = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

# A subscriber that joins late gets the last message.
LATCHED = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)

MAX_DEPTH = 100_000
"""Largest depth that can be set: twenty times that of bench samples; chosen by us."""

DIAGNOSTICS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


def overridable(profile: QoSProfile) -> dict[str, Any]:
    """Let `qos_overrides.<topic>.<publisher|subscription>.<policy>` change a profile at start."""
    # A copy for each topic: rclpy writes the overrides into the profile that it is given.
    return {
        "qos_profile": copy.copy(profile),
        "qos_overriding_options": QoSOverridingOptions.with_default_policies(
            callback=_checked
        ),
    }


def misfit(publisher: TopicEndpointInfo, subscription: Subscription) -> str:
    """Return why a subscription does not hear a publisher on its topic; empty when it does."""
    kind = subscription.msg_type
    needed = f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"
    if publisher.topic_type != needed:
        return f"it publishes {publisher.topic_type}; needs {needed}"
    fit, reason = qos_check_compatible(publisher.qos_profile, subscription.qos_profile)
    if fit != QoSCompatibility.ERROR:
        return ""
    return str(reason).replace("ERROR: ", "").rstrip(";")


def _checked(profile: QoSProfile) -> SetParametersResult:
    """Accept an overridden profile, unless its depth is not one that the middleware can use."""
    if 1 <= profile.depth <= MAX_DEPTH:
        return SetParametersResult(successful=True)
    reason = f"depth {profile.depth}; allowed 1 to {MAX_DEPTH}"
    return SetParametersResult(successful=False, reason=reason)

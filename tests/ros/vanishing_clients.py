# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A hundred clients that call the nodes named and vanish without a word; run by the tests.

python vanishing_clients.py NODE ...
"""

import os
import sys
import time

import rclpy
from rcl_interfaces.srv import GetParameters

CLIENTS = 100
PATIENCE = 60.0
"""Time for the nodes to be found on a busy machine [s]."""

rclpy.init()
client_nodes = [
    rclpy.create_node(
        f"vanishing{number}", start_parameter_services=False, enable_rosout=False
    )
    for number in range(CLIENTS)
]
services = [f"{name}/get_parameters" for name in sys.argv[1:]]
clients = [
    node.create_client(GetParameters, service)
    for node in client_nodes
    for service in services
]
end = time.monotonic() + PATIENCE
for client in clients:
    assert client.wait_for_service(end - time.monotonic())
for client in clients:
    client.call_async(GetParameters.Request(names=["use_sim_time"]))
# Neither waits for a reply nor takes leave: the middleware of the nodes has to find that out.
os._exit(0)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Start the node: `ros2 launch hmcvt_ros hmcvt.launch.py params_file:=my.yaml`."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# Installed and in a checkout, config/ and launch/ have the same parent.
DEFAULTS = Path(__file__).resolve().parent.parent / "config" / "hmcvt.yaml"

ARGUMENTS = {
    "params_file": (str(DEFAULTS), "YAML with parameters of the node"),
    "namespace": ("", "namespace of the node and its topics"),
    "name": ("hmcvt", "name of the node"),
    "use_sim_time": ("false", "follow /clock"),
    "log_level": ("info", "debug, info, warn or error"),
    "enclave": ("/", "SROS2 enclave"),
    "respawn": ("true", "start the node again when it has ended"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the launch description."""
    declarations = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    node = Node(
        package="hmcvt_ros",
        executable="efficiency_node",
        name=LaunchConfiguration("name"),
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {
                "use_sim_time": ParameterValue(
                    LaunchConfiguration("use_sim_time"), value_type=bool
                )
            },
        ],
        arguments=[
            "--ros-args",
            "--log-level",
            LaunchConfiguration("log_level"),
            "--enclave",
            LaunchConfiguration("enclave"),
        ],
        output="screen",
        # launch does so after any end but its own, wrong parameters too; hence not at once.
        respawn=LaunchConfiguration("respawn"),
        respawn_delay=2.0,
    )
    return LaunchDescription([*declarations, node])

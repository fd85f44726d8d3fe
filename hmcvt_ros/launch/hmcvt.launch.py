# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Start the node: `ros2 launch hmcvt_ros hmcvt.launch.py model_file:=my_unit.yaml`."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# Installed and in a checkout, config/ and launch/ have the same parent.
DEFAULTS = Path(__file__).resolve().parent.parent / "config" / "hmcvt.yaml"

ARGUMENTS = {
    "params_file": (str(DEFAULTS), "YAML with parameters of the node"),
    "model_file": ("", "parameter file of the model; empty for that of params_file"),
    "engine_file": ("", "engine file; empty for that of params_file"),
    "state_folder": ("", "state folder; empty for that of params_file"),
    "namespace": ("", "namespace of the node and its topics"),
    "name": ("hmcvt", "name of the node"),
    "displacement_ratio": ("displacement_ratio", "topic of this input"),
    "engine_speed": ("engine_speed", "topic of this input"),
    "load_torque": ("load_torque", "topic of this input"),
    "oil_temperature": ("oil_temperature", "topic of this input"),
    "operating_point": ("operating_point", "topic of this input"),
    "stage": ("stage", "topic of this input"),
    "session": ("session", "topic of this input"),
    "bench_sample": ("bench_sample", "topic of this input"),
    "use_sim_time": ("false", "follow /clock"),
    "log_level": ("info", "debug, info, warn or error"),
    "enclave": ("/", "SROS2 enclave"),
    "respawn": ("true", "start the node again when it has ended"),
}
FILES = ("model_file", "engine_file", "state_folder")
INPUTS = (
    "displacement_ratio",
    "engine_speed",
    "load_torque",
    "oil_temperature",
    "operating_point",
    "stage",
    "session",
    "bench_sample",
)


def given_files(context: LaunchContext) -> dict[str, str]:
    """Return the files that were named as arguments; they take precedence over params_file."""
    files = {}
    for name in FILES:
        value = LaunchConfiguration(name).perform(context)
        if value:
            files[name] = value
    return files


def node(context: LaunchContext) -> list[Node]:
    """Return the node, once the values of the arguments are known."""
    parameters = [
        LaunchConfiguration("params_file"),
        {
            "use_sim_time": ParameterValue(
                LaunchConfiguration("use_sim_time"), value_type=bool
            )
        },
    ]
    files = given_files(context)
    if files:
        parameters.append(files)
    return [
        Node(
            package="hmcvt_ros",
            executable="efficiency_node",
            name=LaunchConfiguration("name"),
            namespace=LaunchConfiguration("namespace"),
            parameters=parameters,
            remappings=[(topic, LaunchConfiguration(topic)) for topic in INPUTS],
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
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the launch description."""
    declarations = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declarations, OpaqueFunction(function=node)])

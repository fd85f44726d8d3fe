# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: one table that declares, checks and documents them."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from hmcvt_core import InputError
from hmcvt_core.interface import (
    DISPLACEMENT_RATIO,
    EFFICIENCY_STD,
    ENGINE_SPEED,
    ENGINE_SPEED_LIMITS,
    HOLDS,
    LOAD_TORQUE,
    MAX_CHANGE,
    Range,
)

from .inputs import INPUT_RANGES, NANOSECONDS, AgeLimits

MAP_POINTS_LIMIT = 100_000
"""Maximum number of points of the efficiency map (0.8 MB as a message)."""

SHORTEST_TIMEOUT = 0.01
LONGEST_TIMEOUT = 60.0
"""Limits of the age limits of the inputs [s]."""

SLOWEST_RATE = 1.0
"""Lowest limit to the rate of the outputs [Hz], that of the diagnostics: below it a limit that
anyone on the network sets would amount to silence."""

SILENCE = "silence"
NAN = "nan"
"""What the outputs do where there is no answer."""

ADOPT = "adopt"
STAGE = "stage"
"""What becomes of a refit."""

TEXT_LIMIT = 4096
"""Most characters of a text: parameters can be set from the network."""


_HELP_WIDTH = 88


@dataclass(frozen=True)
class Declaration:
    """One parameter.

    Attributes:
        default: default value; its type is that of the parameter.
        description: what it does, as a sentence.
        limits: closed interval of the value, or of each element of an array.
        unit: unit of the value; empty where there is none.
        choices: allowed texts; empty when any text is.
        read_only: whether it can be given at the start only.
        protects: whether it is a limit that protects the node: it can be set at run time only with
            `limits_at_run_time`.
        is_path: whether it names a file, whose folder other nodes need not know.
        name: name as in YAML; a dot stands for a level.
    """

    default: Any
    description: str
    limits: tuple[float, float] | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()
    read_only: bool = False
    protects: bool = False
    is_path: bool = False
    name: str = ""

    @property
    def allowed(self) -> str:
        """Allowed values in words; empty when all of its type are."""
        if self.choices:
            return " or ".join(self.choices)
        if self.limits is None:
            return ""
        low, high = self.limits
        interval = f"{low:.10g} to {high:.10g} {self.unit}".rstrip()
        if isinstance(self.default, list):
            return f"each {interval}"
        return interval

    def check(self, value: Any) -> None:
        """Refuse a value.

        Raises:
            InputError: it is no choice, out of range, too long or not printable.
        """
        if isinstance(value, str):
            self._check_text(value)
        if self.choices and value not in self.choices:
            raise InputError(
                f"{self.name} = {value!r}; there is {', '.join(self.choices)}"
            )
        if self.limits is None:
            return
        low, high = self.limits
        if isinstance(value, (int, float)) and low <= value <= high:
            return
        # The middleware checks single numbers too, but lets NaN through and skips arrays.
        Range(self.name, low, high, self.unit or "-").check(value)

    def _check_text(self, value: str) -> None:
        if len(value) > TEXT_LIMIT:
            raise InputError(
                f"{self.name} has {len(value)} characters; allowed are {TEXT_LIMIT}"
            )
        if not value.isprintable():
            raise InputError(f"{self.name} = {value!r} has control characters")

    def descriptor(self, limits_at_run_time: bool = False) -> ParameterDescriptor:
        """Return what `ros2 param describe` shows.

        Args:
            limits_at_run_time: whether limits that protect the node can be set at run time.
        """
        text = self.description
        if self.unit:
            text = f"{text} [{self.unit}]"
        descriptor = ParameterDescriptor(
            description=text,
            read_only=self.read_only or (self.protects and not limits_at_run_time),
            additional_constraints=self.allowed,
        )
        if self.limits is not None and not isinstance(self.default, list):
            low, high = self.limits
            if isinstance(self.default, int):
                descriptor.integer_range = [
                    IntegerRange(from_value=int(low), to_value=int(high))
                ]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=float(low), to_value=float(high))
                ]
        return descriptor


def _parameter(*values: Any, **options: Any) -> Any:
    return field(metadata={"declaration": Declaration(*values, **options)})


def _input_timeout(limits: Range) -> Any:
    return _parameter(
        0.0,
        f"Age at which {limits.name} is stale; 0 for input_timeout.",
        (0.0, LONGEST_TIMEOUT),
        "s",
        protects=True,
    )


@dataclass(frozen=True)
class Settings:
    """The values of all parameters, checked; the fields are the table of parameters.

    Raises:
        InputError: a value is out of range; the parameter is named.
    """

    model_file: str = _parameter(
        "",
        "Parameter file of the model to start from; empty for the paper's stage, "
        "params/hm4.yaml. A model refitted from it in an earlier run is taken up again from the "
        "state folder.",
        read_only=True,
        is_path=True,
    )
    engine_file: str = _parameter(
        "",
        "Engine file (full-load curve and fuel map): fuel in advice, and with optimum_hold "
        "output_speed the least fuel; empty for none.",
        read_only=True,
        is_path=True,
    )
    effects_file: str = _parameter(
        "",
        "Module or Python file with effects of your own, for model files that hold them and "
        "for ~/diagnose; empty for none. What it holds is run.",
        read_only=True,
        is_path=True,
    )
    state_folder: str = _parameter(
        "",
        "Folder for the bench log, refitted models and reports; empty for $ROS_HOME (else "
        "~/.ros) / name of the node with its namespace.",
        read_only=True,
        is_path=True,
    )
    samples_file: str = _parameter(
        "",
        "Bench CSV inside the state folder that ~/reidentify and ~/diagnose read; empty for "
        "the log of bench_sample.",
    )
    input_timeout: float = _parameter(
        0.5,
        "Age of its last message at which an input is stale; there is no output before all "
        "three are fresh.",
        (SHORTEST_TIMEOUT, LONGEST_TIMEOUT),
        "s",
        protects=True,
    )
    input_timeouts_displacement_ratio: float = _input_timeout(DISPLACEMENT_RATIO)
    input_timeouts_engine_speed: float = _input_timeout(ENGINE_SPEED)
    input_timeouts_load_torque: float = _input_timeout(LOAD_TORQUE)
    oil_temperature_timeout: float = _parameter(
        30.0,
        "Age at which oil_temperature is stale and counts as unknown.",
        (SHORTEST_TIMEOUT, 3600.0),
        "s",
        protects=True,
    )
    max_input_skew: float = _parameter(
        0.0,
        "Time between the oldest and the newest of the three inputs beyond which there is no "
        "output: they do not belong together; 0 for no limit but their ages.",
        (0.0, LONGEST_TIMEOUT),
        "s",
        protects=True,
    )
    invalid_output: str = _parameter(
        SILENCE,
        "What the outputs do while an input is missing, stale or refused, or the model "
        "has no answer: silence, or nan for every arrival and ten times a second when none comes.",
        choices=(SILENCE, NAN),
    )
    max_output_rate: float = _parameter(
        0.0,
        "Limit to the rate of the outputs by the wall clock, at least 1 Hz, the last input is "
        "always answered; 0 answers every arrival.",
        (0.0, 1000.0),
        "Hz",
    )
    optimum_hold: str = _parameter(
        HOLDS[0],
        "What stays the same when the displacement ratio is optimised, in addition to the "
        "output power.",
        choices=HOLDS,
    )
    vehicle_file: str = _parameter(
        "",
        "Vehicle file with the limits of the machine: with an engine and optimum_hold "
        "output_speed the causal strategy of hmcvt mission answers, so that stage and engine "
        "speed do not hunt; empty for the optimum without limits.",
        read_only=True,
        is_path=True,
    )
    engine_speed_limits: tuple[float, float] = _parameter(
        [round(limit, 2) for limit in ENGINE_SPEED_LIMITS],
        "Engine speeds that the optimum may use and the map covers.",
        (ENGINE_SPEED.low, ENGINE_SPEED.high),
        "rad/s",
    )
    map_load_torque_limits: tuple[float, float] = _parameter(
        [50.0, 400.0],
        "Load torques that the map covers.",
        (LOAD_TORQUE.low, LOAD_TORQUE.high),
        "N m",
        read_only=True,
    )
    map_points: tuple[int, int, int] = _parameter(
        [41, 17, 15],
        "Points of the map along displacement ratio, engine speed, load torque.",
        (2, 500),
        read_only=True,
    )
    reidentify_min_samples: int = _parameter(
        4,
        "Fewest samples that ~/reidentify accepts.",
        (1, 100_000),
        protects=True,
    )
    reidentify_seed: int = _parameter(
        0,
        "Seed of the random numbers of ~/reidentify and ~/diagnose, so that they can be "
        "repeated.",
        (0, 2**31 - 1),
    )
    reidentify_mode: str = _parameter(
        ADOPT,
        "What ~/reidentify does with a good refit: adopt puts it into service, stage "
        "writes it and waits for ~/adopt.",
        choices=(ADOPT, STAGE),
        protects=True,
    )
    reidentify_max_change: float = _parameter(
        MAX_CHANGE,
        "Largest change of the efficiency within the domain, against the model in service and "
        "the last model put there by ~/adopt or model_file, that ~/reidentify adopts; a larger "
        "one waits for ~/adopt. The first refit of a model that states no errors may be larger.",
        (0.0, 1.0),
        protects=True,
    )
    reidentify_max_drift: float = _parameter(
        0.1,
        "Largest mean difference between a refit and the model of model_file (the first "
        "refit, if that states no errors), in efficiency within the domain, that ~/reidentify "
        "accepts.",
        (0.0, 1.0),
        protects=True,
    )
    bench_noise: float = _parameter(
        0.0,
        "Standard deviation of the efficiency of a bench sample, for the watch on the gap and "
        "~/diagnose; 0 for 1.12 % of the efficiency, as the paper states (~/diagnose: for the "
        "scatter of repeated samples, where there are any).",
        (0.0, EFFICIENCY_STD.high),
        read_only=True,
    )
    baseline_file: str = _parameter(
        "",
        "Bench CSV of this transmission when it was sound, or of a sister: ~/diagnose fits it "
        "first, holds it and diagnoses what has changed since; empty for none.",
        read_only=True,
        is_path=True,
    )
    job_time_limit: float = _parameter(
        300.0,
        "Time after which a refit or a diagnosis is ended.",
        (1.0, 86_400.0),
        "s",
        protects=True,
    )
    job_memory_limit: int = _parameter(
        1024,
        "Memory that a refit or a diagnosis may take.",
        (512, 1_048_576),
        "MiB",
        protects=True,
    )
    bench_log_limit: int = _parameter(
        100_000,
        "Samples that the bench log holds before it refuses more.",
        (1, 10_000_000),
        read_only=True,
    )
    limits_at_run_time: bool = _parameter(
        False,
        "Whether the limits that protect the node can be set at run time: ages, skew, and those "
        "of refits and jobs.",
        read_only=True,
    )

    def __post_init__(self) -> None:
        for declaration in PARAMETERS:
            declaration.check(getattr(self, _field(declaration.name)))
        self._check_timeouts()
        self._check_map()
        if 0.0 < self.max_output_rate < SLOWEST_RATE:
            raise InputError(
                f"max_output_rate = {self.max_output_rate:g}; needs 0 for every arrival, or at "
                f"least {SLOWEST_RATE:g} Hz"
            )

    def _check_timeouts(self) -> None:
        for name, timeout in self.input_timeouts.items():
            if timeout < SHORTEST_TIMEOUT:
                raise InputError(
                    f"input_timeouts.{name} = {timeout:g}; needs 0 for input_timeout, "
                    f"or at least {SHORTEST_TIMEOUT:g} s"
                )

    def _check_map(self) -> None:
        for name in ("engine_speed_limits", "map_load_torque_limits"):
            limits = getattr(self, name)
            if len(limits) != 2 or not limits[0] < limits[1]:
                raise InputError(f"{name} = {list(limits)}; needs two rising numbers")
        if len(self.map_points) != 3 or math.prod(self.map_points) > MAP_POINTS_LIMIT:
            raise InputError(
                f"map_points = {list(self.map_points)}; needs three counts whose "
                f"product is at most {MAP_POINTS_LIMIT}"
            )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Settings:
        """Take the fields from a mapping of parameter values, ignoring the rest."""
        taken: dict[str, Any] = {}
        for item in PARAMETERS:
            value = values[item.name]
            if isinstance(item.default, list):
                value = tuple(value)
            taken[_field(item.name)] = value
        return cls(**taken)

    @cached_property
    def input_timeouts(self) -> dict[str, float]:
        """Age limit of each input by name [s]."""
        return {
            limits.name: getattr(self, f"input_timeouts_{limits.name}")
            or self.input_timeout
            for limits in INPUT_RANGES
        }

    @cached_property
    def oil_age_limit(self) -> int:
        """Age limit of the oil temperature [ns]."""
        return _nanoseconds(self.oil_temperature_timeout)

    @cached_property
    def age_limits(self) -> AgeLimits:
        """How old the inputs may be, as they are compared at every arrival."""
        timeouts = self.input_timeouts
        # Without a limit for it, the skew is bounded by the longest age.
        skew = self.max_input_skew or LONGEST_TIMEOUT
        return AgeLimits(
            ages=(
                _nanoseconds(timeouts[DISPLACEMENT_RATIO.name]),
                _nanoseconds(timeouts[ENGINE_SPEED.name]),
                _nanoseconds(timeouts[LOAD_TORQUE.name]),
            ),
            skew=_nanoseconds(skew),
        )


_LEVEL = ("input_timeouts_", "input_timeouts.")
PARAMETERS: tuple[Declaration, ...] = tuple(
    replace(item.metadata["declaration"], name=item.name.replace(*_LEVEL))
    for item in fields(Settings)
)
"""All parameters, in the order of the table."""


_UNLOCK = "limits_at_run_time"


def _field(name: str) -> str:
    return name.replace(".", "_")


def map_axes(
    points: tuple[int, int, int],
    engine_speeds: tuple[float, float],
    load_torques: tuple[float, float],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the axes of the map: displacement ratios [-], engine speeds, load torques.

    Args:
        points: count of points along each axis.
        engine_speeds: lowest and highest engine speed [rad/s].
        load_torques: lowest and highest load torque [N m].
    """
    return (
        np.linspace(DISPLACEMENT_RATIO.low, DISPLACEMENT_RATIO.high, points[0]),
        np.linspace(*engine_speeds, points[1]),
        np.linspace(*load_torques, points[2]),
    )


def _nanoseconds(seconds: float) -> int:
    return round(seconds / NANOSECONDS)


def declare(node: Node) -> Settings:
    """Declare all parameters on a node, refuse bad values from then on, and return the first.

    Raises:
        InputError: a value given at start is of the wrong type or out of range.
    """
    paths: dict[str, Any] = {}
    unlocked = node._parameter_overrides.get(_UNLOCK)
    limits_at_run_time = unlocked is not None and unlocked.value is True
    for declaration in PARAMETERS:
        name = declaration.name
        given = node._parameter_overrides.get(name, Parameter(name)).value
        if NAN in declaration.choices and _is_nan(given):
            # ROS reads nan on the command line and in a file as a number.
            node._parameter_overrides[name] = Parameter(name, value=NAN)
        if declaration.is_path and isinstance(given, str) and given:
            # Everyone on the network can read parameters.
            paths[name] = _expanded(name, given)
            node._parameter_overrides[name] = Parameter(name, value=Path(given).name)
        try:
            descriptor = declaration.descriptor(limits_at_run_time)
            node.declare_parameter(name, declaration.default, descriptor)
        except InvalidParameterTypeException:
            raise InputError(_wrong_type(declaration, given)) from None
        except InvalidParameterValueException as error:
            raise InputError(
                f"parameter {name} = {given!r}: allowed {declaration.allowed}"
            ) from error
    return replace(current(node), **paths)


def _expanded(name: str, path: str) -> str:
    """Return a path with the home folder in place of `~`, which a shell leaves after `:=`.

    The path is absolute, because some files are read again when the program may have changed its
    working directory. The name of a module with effects stays.

    Raises:
        InputError: there is no such home folder.
    """
    is_module = name == "effects_file" and not path.endswith(".py")
    try:
        return path if is_module else str(Path(path).expanduser().absolute())
    except RuntimeError:
        raise InputError(
            f"parameter {name} = {path!r}: ~ names no home folder"
        ) from None


def after(settings: Settings, node: Node) -> Settings:
    """Return the settings that a node holds after changes to some; files stay."""
    paths = {
        declaration.name: getattr(settings, declaration.name)
        for declaration in PARAMETERS
        if declaration.is_path
    }
    return replace(current(node), **paths)


def files(settings: Settings) -> list[str]:
    """Return the paths that the settings name."""
    paths = [
        getattr(settings, declaration.name)
        for declaration in PARAMETERS
        if declaration.is_path
    ]
    return [path for path in paths if path]


def changes(start: Settings, now: Settings, limits_only: bool = False) -> str:
    """Return which parameters differ from those at the start, in words.

    Args:
        start: settings at the start.
        now: present settings.
        limits_only: whether to look at the limits that protect the node only.
    """
    changed = []
    for declaration in PARAMETERS:
        before = getattr(start, _field(declaration.name))
        value = getattr(now, _field(declaration.name))
        if value != before and (declaration.protects or not limits_only):
            changed.append(f"{declaration.name} {before} -> {value}")
    return "; ".join(changed)


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _wrong_type(declaration: Declaration, given: Any) -> str:
    text = (
        f"parameter {declaration.name} = {given!r}: needs one like "
        f"{declaration.default!r}"
    )
    if isinstance(declaration.default, float) and isinstance(given, int):
        return f"{text}; write {float(given)!r}, a whole number is another type in ROS"
    if isinstance(declaration.default, float) and isinstance(given, str):
        return f"{text}; where the locale has a decimal comma, set LC_NUMERIC=C"
    return text


def current(node: Node, changes: Sequence[Parameter] = ()) -> Settings:
    """Return the settings that a node holds, or would with some changes."""
    values = {item.name: node.get_parameter(item.name).value for item in PARAMETERS}
    return Settings.of(values | {change.name: change.value for change in changes})


def check_changes(node: Node, changes: Sequence[Parameter]) -> SetParametersResult:
    """Check that changed values fit together with the rest; for the on-set callback."""
    if not all(change.name for change in changes):  # rclpy would declare it
        return SetParametersResult(
            successful=False, reason="a parameter without a name"
        )
    try:
        current(node, changes)
    except (InputError, TypeError) as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def applies_to(path: Path, node: str) -> bool:
    """Return whether a parameter file of ROS has a section for a node.

    Args:
        path: the file, which ROS has read.
        node: full name of the node.
    """
    sections = _sections(yaml.safe_load(path.read_text(encoding="utf-8")))
    return any(re.fullmatch(pattern, node) for pattern in sections)


def _sections(content: Any, above: str = "") -> list[str]:
    """Return the nodes that a part of a parameter file is for, as expressions of full names."""
    patterns = []
    for key, value in content.items() if isinstance(content, dict) else ():
        name = f"{above}/{str(key).strip('/')}"
        if isinstance(value, dict) and "ros__parameters" in value:
            # As in rcl: ** stands for any namespaces, * for a part of a name.
            pattern = re.escape(name).replace(r"/\*\*", "(/[^/]+)*")
            patterns.append(pattern.replace(r"\*", "[^/]*"))
        else:
            patterns += _sections(value, name)
    return patterns


def usage() -> str:
    """Return what `--help` prints: how parameters are given, and the list of them."""
    lines = [
        "usage: hmcvt-node [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO]]",
        "",
        "The ROS 2 node hmcvt: efficiency of a hydromechanical CVT. Parameters:",
        "",
    ]
    for item in PARAMETERS:
        facts = [f"default {item.default!r}"]
        if item.allowed:
            facts.append(item.allowed)
        if item.read_only:
            facts.append("read at start only")
        if item.protects:
            facts.append("at run time only with limits_at_run_time")
        unit = f" [{item.unit}]" if item.unit else ""
        lines.append(f"  {item.name}{unit}, {'; '.join(facts)}")
        description = textwrap.fill(item.description, _HELP_WIDTH)
        lines.append(textwrap.indent(description, " " * 6))
    return "\n".join(lines)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a system of your own needs next to its model: a base for its effects, and its readings.

A `System` is any model on a bench; `examples/own_system.py` has one, a fan. `simulator` makes one
of a function.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..diagnosis.observations import (
    Observations,
    assumed_prior_dof,
    noise_statement,
)
from ..diagnosis.settings import PRIOR_DOF_STATED
from ..diagnosis.system import Array, Channel, System
from ..errors import InputError
from ..files.table import read_plain
from ..physics.effects import import_source
from ..physics.effects.base import Parametrised

_MEMBERS = (
    "axes",
    "channels",
    "base",
    "library",
    "predict",
    "candidates",
    "lost_power",
    "model_of",
    "remarks",
)
"""What `load_system` looks for in a system."""
DEVIATION = "_std"
"""Ending of a column with the standard deviations of a channel."""


@dataclass(frozen=True)
class SystemEffect(Parametrised):
    """Base of the effects of an own system.

    Fields declared with `hmcvt.size` and `hmcvt.shape` are the parameters of an effect; the first
    size is fitted. The effects of a transmission derive from `hmcvt.Effect` instead, which also
    lists them in its library.

    Class attributes:
        name: what the effect is called in results.
        form: which of the forms of that name; empty where there is one.
        component: the part that it belongs to; `sensor` for an error of the bench.
        summary: what it does, in plain words.
        source: where its form comes from.
        remedy: the measurement that settles it when no operating point can; may be empty.
    """

    name: ClassVar[str] = ""
    form: ClassVar[str] = ""
    component: ClassVar[str] = ""
    summary: ClassVar[str] = ""
    source: ClassVar[str] = ""
    remedy: ClassVar[str] = ""


@dataclass(frozen=True, eq=False)
class Readings:
    """Samples of an own system; each column is an attribute too, as of `BenchSamples`.

    Attributes:
        columns: by the name of the axis or channel, shape (n,).
        source: where they come from, for messages.
        sha256: of the file, empty where there is none.
    """

    columns: Mapping[str, Array]
    source: str = "samples"
    sha256: str = ""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getattr__(self, name: str) -> Array:
        if name != "columns" and name in self.columns:
            return self.columns[name]
        raise AttributeError(name)

    def select(self, index: NDArray[Any]) -> Readings:
        """Return the samples at an index array or mask, in that order."""
        chosen = {name: values[index] for name, values in self.columns.items()}
        return replace(self, columns=chosen)


def observe_system(
    system: System,
    columns: Mapping[str, ArrayLike],
    *,
    noise: Mapping[str, ArrayLike] = MappingProxyType({}),
    source: str = "samples",
) -> Observations:
    """Set up the readings of an own system for `diagnose_system`.

    Args:
        system: states axes and channels; axes that are only recorded may be missing, and all
            channels but the first.
        columns: readings by the name of the axis or channel, each of shape (n,); others are kept.
        noise: standard deviation of channels by name, in the unit of the channel, scalar or of
            shape (n,). A channel without one takes repeated points (the first only), or its
            `uncertainty`.
        source: where the readings come from, for messages.

    Raises:
        InputError: a column is missing, of another length, or holds no number.
    """
    table = _checked(columns, source)
    needed = [axis.name for axis in system.axes if axis.steered]
    needed.append(system.channels[0].name)
    for name in needed:
        if name not in table:
            raise InputError(f"{source}: column {name} is missing")
    axes = tuple(axis for axis in system.axes if axis.name in table)
    points = {axis.name: table[axis.name] for axis in axes}
    channels = tuple(channel for channel in system.channels if channel.name in table)
    first = channels[0]
    stated = _stated(noise, first, table)
    first_deviation, first_dof, origin = noise_statement(
        first, table[first.name], None, stated, axes, points
    )
    deviation = [first_deviation]
    prior_dof = [first_dof]
    for channel in channels[1:]:
        stated = _stated(noise, channel, table)
        if stated is None:
            deviation.append(channel.deviation(table[channel.name]))
            prior_dof.append(assumed_prior_dof(len(table[first.name])))
        else:
            deviation.append(stated)
            prior_dof.append(PRIOR_DOF_STATED)
    return Observations(
        axes=axes,
        points=points,
        channels=channels,
        measured=np.stack([table[channel.name] for channel in channels]),
        deviation=np.stack(deviation),
        prior_dof=np.array(prior_dof),
        samples=Readings(table, source),
        number=np.arange(len(table[first.name])),
        noise_source=_noise_source(noise, first, origin),
        assumed=origin is None,
    )


def load_system(target: str) -> System:
    """Load a system by module and name.

    Args:
        target: `module:NAME` or `path/to/file.py:NAME`; NAME is a system, or a class or function
            without arguments that makes one.

    Raises:
        InputError: the target has another form, cannot be imported, or is no system.
    """
    source, colon, name = target.rpartition(":")
    if not (source and colon and name.isidentifier()):
        raise InputError(f"{target!r}: write module:NAME or file.py:NAME")
    module = import_source(source)
    if not hasattr(module, name):
        public = [item for item in vars(module) if not item.startswith("_")]
        raise InputError(f"{source}: holds no {name}; there is {', '.join(public)}")
    system = getattr(module, name)
    if isinstance(system, type) or not hasattr(system, "predict"):
        if not callable(system):
            raise InputError(f"{target}: is a {type(system).__name__}, no system")
        try:
            system = system()
        except Exception as error:  # whatever somebody else's module may raise
            raise InputError(
                f"{target}: cannot be called: {type(error).__name__}: {error}"
            ) from error
    missing = [member for member in _MEMBERS if not hasattr(system, member)]
    if missing:
        raise InputError(f"{target}: is no system: {', '.join(missing)} missing")
    loaded: System = system
    return loaded


def read_observations(
    system: System,
    path: str | os.PathLike[str],
    *,
    noise: Mapping[str, float] = MappingProxyType({}),
) -> tuple[Observations, tuple[str, ...]]:
    """Read the readings of an own system from CSV.

    Args:
        system: states axes and channels, which name the columns; `<channel>_std` holds standard
            deviations.
        path: of the file.
        noise: standard deviation of channels by name, in the unit of the channel; instead of a
            column.

    Returns:
        The observations, and notes on columns that are not used.

    Raises:
        InputError: a column is missing, or a value is no number; noise of no channel read.
    """
    table = read_plain(path)
    known = [axis.name for axis in system.axes]
    known += [channel.name for channel in system.channels]
    readings = {name: table.numbers(name) for name in table.columns if name in known}
    read = [channel.name for channel in system.channels if channel.name in readings]
    stated: dict[str, ArrayLike] = {}
    for name in read:
        if f"{name}{DEVIATION}" in table.columns:
            stated[name] = table.numbers(f"{name}{DEVIATION}")
    for name, deviation in noise.items():
        if name not in read:
            raise InputError(
                f"noise of {name}: {table.source} has no such channel; it has "
                f"{', '.join(read) or 'none'}"
            )
        stated[name] = deviation
    used = {*known, *(f"{name}{DEVIATION}" for name in read)}
    ignored = [name for name in table.columns if name not in used]
    notes: tuple[str, ...] = ()
    if ignored:
        notes = (
            f"not used, neither axis nor channel of the system: {', '.join(ignored)}",
        )
    observed = observe_system(system, readings, noise=stated, source=table.source)
    samples = replace(observed.samples, sha256=table.sha256)
    return replace(observed, samples=samples), notes


def _checked(columns: Mapping[str, ArrayLike], source: str) -> dict[str, Array]:
    """Return columns of numbers of one length."""
    table: dict[str, Array] = {}
    for name, values in columns.items():
        try:
            column = np.asarray(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(f"{source}: column {name} holds no numbers") from error
        if column.ndim != 1 or not np.isfinite(column).all():
            raise InputError(
                f"{source}: column {name} is not one row of finite numbers"
            )
        table[name] = column
    lengths = {name: len(column) for name, column in table.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(f"{source}: columns differ in length: {lengths}")
    return table


def _stated(
    noise: Mapping[str, ArrayLike], channel: Channel, table: Mapping[str, Array]
) -> Array | None:
    """Return the stated standard deviation of a channel at each sample, shape (n,), or None."""
    if channel.name not in noise:
        return None
    shape = table[channel.name].shape
    deviation = np.broadcast_to(np.asarray(noise[channel.name], dtype=float), shape)
    if not (deviation > 0.0).all():
        raise InputError(f"noise of {channel.name} is not positive")
    return np.array(deviation)


def _noise_source(
    noise: Mapping[str, ArrayLike], channel: Channel, origin: str | None
) -> str:
    if channel.name in noise:
        return "given"
    return origin or f"assumed, uncertainty of {channel.name}"

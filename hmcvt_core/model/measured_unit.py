# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the test of a single pump or motor contributes to the model of a transmission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ..errors import InputError
from ..transmission.mapping import number

KINDS = ("pump", "motor")
"""Kinds of hydrostatic units."""


@dataclass(frozen=True)
class MeasuredUnit:
    """Leakage of a pump or motor that was tested by itself.

    Attributes:
        leakage_per_displacement: leakage per pressure and displacement [rad/(s Pa)].
        decades: standard error of log10 of the leakage [-].
        data: name of the file with the tests.
        data_sha256: of that file.
    """

    leakage_per_displacement: float
    decades: float
    data: str = ""
    data_sha256: str = ""

    def to_mapping(self) -> dict[str, Any]:
        """Return plain data, as a parameter file holds it."""
        return asdict(self)


def measured_units(data: object) -> dict[str, MeasuredUnit]:
    """Read the units of a parameter file that were tested by themselves, by kind.

    Args:
        data: section `provenance.units` of the file.

    Raises:
        InputError: a kind is unknown, or a field is missing or no number; the field is named.
    """
    where = "provenance.units"
    if not isinstance(data, Mapping):
        raise InputError(f"{where} = {data!r} is not a mapping")
    units = {}
    for kind, entry in data.items():
        if kind not in KINDS:
            raise InputError(f"{where}: {kind!r} is not pump or motor")
        if not isinstance(entry, Mapping):
            raise InputError(f"{where}.{kind} = {entry!r} is not a mapping")
        units[kind] = MeasuredUnit(
            number(
                entry.get("leakage_per_displacement"),
                f"{where}.{kind}.leakage_per_displacement",
            ),
            number(entry.get("decades"), f"{where}.{kind}.decades"),
            str(entry.get("data", "")),
            str(entry.get("data_sha256", "")),
        )
    return units

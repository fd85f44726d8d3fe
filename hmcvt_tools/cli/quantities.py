# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers with units as options take them: 1400rpm, 40kW, 50%."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import click

from ..tables.numbers import parsed
from ..tables.units import to_si


def _reader(name: str, example: str, kind: str = "") -> Callable[[Any], float]:
    """Return a function that reads a number in the SI unit, or with a unit behind it.

    A decimal comma is accepted in a number without a point.

    Args:
        name: what the number is; --help and error messages name it.
        example: shown in error messages.
        kind: what its unit measures, a key of `KIND_UNITS`; `""` for a plain number.
    """

    def read(text: str | float) -> float:
        # Blanks do not count in a number, and `1400 1/min` would read as 14001.
        stripped = str(text).strip().replace(" 1/min", "/min")
        value, unit = parsed(stripped, comma="." not in stripped)
        wrong = click.BadParameter(f"{text!r} is not a {name}: write {example}")
        if math.isnan(value) and stripped.lower() != "nan":
            raise wrong
        if not unit:
            return value
        try:
            size, zero = to_si(kind, unit)
        except KeyError:
            raise wrong from None
        return size * (value - zero)

    read.__name__ = name  # click shows it as the type of the option
    return read


speed = _reader("speed", "146.6 (rad/s) or 1400rpm", "speed")
torque = _reader("torque", "200 (N m) or 1.2kNm", "torque")
power = _reader("power", "40000 (W) or 40kW", "power")
number = _reader("number", "80")
fraction = _reader("fraction", "0.5 or 50%", "part")


def part_up_to(highest: float) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Return an option callback that accepts fractions above 0 and up to `highest`."""

    def checked(
        _: click.Context, __: click.Parameter, value: float | None
    ) -> float | None:
        if value is None or 0.0 < value <= highest:
            return value
        raise click.BadParameter(f"{value:g} is not above 0 and at most {highest:g}")

    return checked


def fractions(text: str) -> list[float]:
    """Read fractions separated by commas."""
    numbers = []
    for part in text.split(","):
        try:
            numbers.append(float(part))
        except ValueError:
            raise click.BadParameter(
                f"{text!r} is not a list of numbers such as 0.98,0.97"
            ) from None
    return numbers


def output_speed(
    ctx: click.Context, _: click.Parameter, value: str | None
) -> float | None:
    """Read an output speed; a ground speed in km/h is converted by tyre and final drive."""
    radius = ctx.params["tyre_radius"]
    final_drive = ctx.params["final_drive"]
    is_ground_speed = value is not None and value.strip().lower().endswith("km/h")
    if value is None or not is_ground_speed:
        if radius is not None or final_drive is not None:
            raise click.UsageError(
                "--tyre-radius and --final-drive are for an --output-speed in km/h"
            )
        return None if value is None else speed(value)
    if not (radius and radius > 0.0 and final_drive and final_drive > 0.0):
        raise click.UsageError(
            "--output-speed in km/h needs --tyre-radius and --final-drive"
        )
    figures = value.lower().replace("km/h", "").strip()
    ground_speed, _unit = parsed(figures, comma="." not in value)
    if math.isnan(ground_speed):
        raise click.BadParameter(f"{value!r} is not a speed: write 8km/h")
    return ground_speed / 3.6 / radius * float(final_drive)

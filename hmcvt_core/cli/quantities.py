# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers with units on the command line, and the operating point that options give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from ..errors import InputError
from ..model.measured import operating_point
from ..model.model import EfficiencyModel
from ..transmission.ranges import RPM
from .common import Function, Point, add_options

_SPEED = {"rpm": RPM, "r/min": RPM, "rad/s": 1.0}
_KMH = 1.0 / 3.6  # m/s


def quantity(text: str | float, units: Mapping[str, float], name: str, example: str) -> float:
    """Read a number in the SI unit, or in one of the `units` (by size) written behind it.

    A unit that ends like another stands before it; a complaint says `name` and `example`. A decimal
    comma is taken where no point stands.
    """
    given = str(text).strip().lower()
    unit = next(filter(given.endswith, units), "")
    number = given.removesuffix(unit).strip()
    try:
        return float(number if "." in number else number.replace(",", ".")) * units.get(unit, 1.0)
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a {name}: write {example}") from None


def speed(text: str | float) -> float:
    """Read a speed in rad/s; a type of options, whose name stands in --help."""
    return quantity(text, _SPEED, "speed", "146.6 (rad/s) or 1400rpm")


def ground_speed(text: str | float) -> float | str:
    """Read a speed as `speed` does; in km/h it stays text until tyre and final drive are known."""
    return str(text) if str(text).strip().lower().endswith("km/h") else speed(text)


def torque(text: str | float) -> float:
    """Read a torque in N m."""
    return quantity(text, {"knm": 1e3, "kn m": 1e3, "nm": 1.0, "n m": 1.0}, "torque",
                    "200 (N m) or 1.2kNm")


def power(text: str | float) -> float:
    """Read a power in W; its name stands in --help."""
    return quantity(text, {"kw": 1e3, "w": 1.0}, "power", "40000 (W) or 40kW")


def fraction(text: str | float) -> float:
    """Read a plain fraction or percent."""
    return quantity(text, {"%": 0.01}, "fraction", "0.5 or 50%")


_MEASURED = (
    click.option("--output-speed", type=ground_speed,
                 help="Of the output shaft: rad/s, 1200rpm; or 8km/h with the next two."),
    click.option("--tyre-radius", type=float, help="Rolling radius in m, for km/h."),
    click.option("--final-drive", type=float,
                 help="Output shaft speed / wheel speed, for km/h."),
    click.option("--output-power", type=power, help="In W or like 40kW."),
    click.option("--output-torque", type=torque, help="Of the output shaft in N m."),
    click.option("--load-torque", type=torque, help="Output power / engine speed in N m."),
    click.option("--engine-torque", type=torque, help="Of the engine in N m."),
)
stage_option = click.option("--stage", metavar="NAME", help="Stage engaged, of several.")


def measured_options(function: Function) -> Function:
    """Add what meters show at either shaft."""
    return add_options(function, *_MEASURED)


def point_options(function: Function) -> Function:
    """Add the options of one operating point, None where left out; see `point_from`."""
    return add_options(
        function,
        click.option("--displacement-ratio", type=fraction,
                     help="Pump stroke, -1 to 1 or in %; or give --output-speed."),
        click.option("--engine-speed", type=speed, help="In rad/s, or like 1400rpm."),
        *_MEASURED,
        click.option("--oil-temperature", type=float, help="Oil temperature in deg C."))


def output_speed(given: Mapping[str, Any]) -> float | None:
    """Return the output speed [rad/s] that the options give.

    Raises:
        UsageError: it is in km/h and tyre radius or final drive are not given, or not positive.
    """
    value, sizes = given["output_speed"], (given["tyre_radius"], given["final_drive"])
    if not isinstance(value, str):
        if any(size is not None for size in sizes):
            raise click.UsageError("--tyre-radius and --final-drive are for an --output-speed in "
                                   "km/h")
        return None if value is None else float(value)
    if not all(size is not None and size > 0.0 for size in sizes):
        raise click.UsageError("--output-speed in km/h needs --tyre-radius and --final-drive")
    return quantity(value, {"km/h": _KMH}, "speed", "8km/h") / sizes[0] * float(sizes[1])


def point_from(given: Mapping[str, Any], model: EfficiencyModel) -> Point:
    """Return the operating point that options give, with what a meter shows turned into it."""
    values = {**given, "output_speed": output_speed(given)}
    if values["engine_speed"] is None:
        raise click.UsageError("--engine-speed is needed")
    try:
        stroke, load = operating_point(model, values["engine_speed"], {
            name: values[name] for name in ("displacement_ratio", "output_speed", "load_torque",
                                            "output_power", "output_torque", "engine_torque")})
    except InputError as error:
        if "is needed" in str(error):
            raise click.UsageError(str(error)) from None
        raise
    return Point(stroke, values["engine_speed"], load, values["oil_temperature"])

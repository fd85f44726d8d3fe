# SPDX-License-Identifier: Apache-2.0
"""What the commands share: options, output, progress."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import click

from ..files.resources import data_path
from ..files.strict_json import plain
from ..model.model import EfficiencyModel
from ..model.parameter_file import load_model
from ..physics.effects import Effect
from ..transmission.ranges import RPM

Function = TypeVar("Function", bound=Callable[..., Any])
_QUIET = 2.0  # seconds of work before progress is shown
_MOST_SAMPLES = 1_000_000


class Quantity(click.ParamType):  # type: ignore[type-arg]
    """A number in the SI unit, or in one of the units written behind it.

    Args:
        name: what it is called.
        units: size of each unit in the SI unit; one that ends like another stands before it.
        example: how to write it.
        limits: lowest and highest value allowed, and both as text; None leaves it to the physics.
    """

    def __init__(
        self, name: str, units: Mapping[str, float], example: str,
        limits: tuple[float, float, str] | None = None,
    ) -> None:
        self.name, self.units, self.example, self.limits = name, units, example, limits

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the value in the SI unit."""
        if isinstance(value, (int, float)):
            return float(value)
        text = str(value).strip().lower()
        unit = next(filter(text.endswith, self.units), "")
        try:
            number = float(text.removesuffix(unit)) * self.units.get(unit, 1.0)
        except ValueError:
            self.fail(f"{value!r} is not a {self.name}: write {self.example}", param, ctx)
        if self.limits is not None and not self.limits[0] <= number <= self.limits[1]:
            self.fail(f"{value!r} is outside {self.limits[2]}", param, ctx)
        return number


SPEED = Quantity("speed", {"rpm": RPM, "r/min": RPM, "rad/s": 1.0}, "146.6 (rad/s) or 1400rpm")
POWER = Quantity("power", {"kw": 1e3, "w": 1.0}, "40000 (W) or 40kW",
                 (100.0, 1e6, "100 W to 1000 kW"))


class SampleNumbers(click.ParamType):  # type: ignore[type-arg]
    """Sample numbers from 1, such as `1,2,4-6`."""

    name = "numbers"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[int]:
        """Return the numbers in the order written."""
        if isinstance(value, list):
            return value
        numbers: list[int] = []
        for part in str(value).split(","):
            first, dash, last = part.strip().partition("-")
            try:
                low, high = int(first), int(last if dash else first)
            except ValueError:
                self.fail(f"{value!r} is not a list of sample numbers such as 1,2,4-6", param, ctx)
            if not 1 <= low <= high <= _MOST_SAMPLES:
                self.fail(f"{part!r}: sample numbers count up from 1 to at most {_MOST_SAMPLES}",
                          param, ctx)
            numbers += range(low, high + 1)
        if len(set(numbers)) != len(numbers):
            self.fail(f"{value!r} names a sample twice", param, ctx)
        return numbers


class Fractions(click.ParamType):  # type: ignore[type-arg]
    """Numbers such as `0.98,0.97`."""

    name = "fractions"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[float]:
        """Return the numbers in the order written."""
        if isinstance(value, list):
            return value
        try:
            return [float(part) for part in str(value).split(",")]
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers such as 0.98,0.97", param, ctx)


class OutputFile(click.ParamType):  # type: ignore[type-arg]
    """A file to write, refused before the work rather than after it when that cannot be done."""

    name = "file"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Return the path."""
        path = Path(value)
        if path.is_dir():
            self.fail(f"{value}: is a folder", param, ctx)
        if path.exists() and not path.is_file():
            return str(value)  # such as /dev/null
        if not path.parent.is_dir():
            self.fail(f"{value}: {path.parent} is not a folder", param, ctx)
        if not os.access(path.parent, os.W_OK):
            self.fail(f"{value}: folder {path.parent} cannot be written", param, ctx)
        return str(value)


class PictureFile(OutputFile):
    """A picture to write; its ending names the format."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Return the path."""
        from ..report.style import picture_format

        picture_format(str(value))
        return super().convert(value, param, ctx)


picture_option = click.option(
    "--picture", type=PictureFile(), default=None, metavar="FILE",
    help="Draw it; the ending (.png, .svg, .html) names the format.")
params_option = click.option(
    "--params", "params", metavar="P.yaml", default=None,
    help="Parameter file of the model; the shipped params/hm4.yaml when left out.")
json_option = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON value and nothing else on stdout.")
seed_option = click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True,
    help="Of the random numbers.")
noise_option = click.option(
    "--noise", type=float, default=None, metavar="STD",
    help="Standard deviation of the efficiency, a fraction (0.004 for 0.4 points).  [default: "
         "column efficiency_std, else repeated points, else 1.12 % of the efficiency]")


def point_options(function: Function) -> Function:
    """Add the options of one operating point."""
    for option in (
        click.option("--oil-temperature", type=float, help="Oil temperature in deg C."),
        click.option("--load-torque", type=float, help="Output power / engine speed in N m."),
        click.option("--engine-speed", type=SPEED, help="In rad/s, or like 1400rpm."),
        click.option("--displacement-ratio", type=float, help="Pump stroke, -1 to 1."),
    ):
        function = option(function)
    return function


def keep_inputs(inputs: Iterable[str | None], outputs: Iterable[str | None]) -> None:
    """Raise a usage error where a command would write over a file that it reads."""
    read = [Path(name).resolve() for name in inputs if name is not None]
    for name in outputs:
        if name is not None and Path(name).resolve() in read:
            raise click.UsageError(f"{name}: is read by this command; write another file")


def require(**values: Any) -> None:
    """Raise a usage error that names the options left out."""
    missing = [f"--{name.replace('_', '-')}" for name, value in values.items() if value is None]
    if missing:
        raise click.UsageError(f"{', '.join(missing)} is needed")


def model_from(path: str | None) -> EfficiencyModel:
    """Load the model asked for, or the shipped one."""
    return load_model(data_path("params/hm4.yaml") if path is None else path)


def note_oil_temperature(model: EfficiencyModel, oil_temperature: float | None) -> None:
    """Say on stderr that a temperature given does nothing, or that one is assumed."""
    used = any(type(effect).viscosity_ratio is not Effect.viscosity_ratio
               for effect in model.effects)
    if oil_temperature is not None and not used:
        click.echo("note: this model has no effect of the oil temperature; --oil-temperature "
                   "changes nothing", err=True)
    elif oil_temperature is None and used:
        click.echo("note: this model depends on the oil temperature; the answer holds at that of "
                   "its identification, 60 deg C", err=True)


def inside_domain(
    model: EfficiencyModel, displacement_ratio: float, engine_speed: float, load_torque: float
) -> bool | None:
    """Tell whether a point lies within the data of the model; None if it does not know them."""
    if model.domain is None:
        return None
    return not model.domain.departures(displacement_ratio, engine_speed, load_torque)


def print_domain(
    model: EfficiencyModel, displacement_ratio: float, engine_speed: float, load_torque: float,
    which: str = "",
) -> None:
    """Say where a point leaves the data that the model comes from."""
    if model.domain is None:
        click.echo("the model does not say what range of data it comes from")
        return
    left = model.domain.departures(displacement_ratio, engine_speed, load_torque)
    if left:
        click.echo(f"{which}outside the range of the data that the model was identified from:")
    for departure in left:
        click.echo(f"  {departure}")


def print_json(value: Any) -> None:
    """Print plain data as JSON; NaN and infinity become null."""
    click.echo(json.dumps(plain(value), indent=1, allow_nan=False))


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return right-aligned columns."""
    lines = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
                     for line in lines)


def number(value: float, form: str, unit: str = "") -> str:
    """Return a number as text, `-` for NaN."""
    return "-" if math.isnan(value) else f"{value:{form}}{unit}"


class Progress:
    """A line on stderr for work that takes over two seconds, on a terminal only."""

    def __init__(self, what: str) -> None:
        self.what, self.start, self.shown = what, time.monotonic(), False

    def __call__(self, text: str) -> None:
        """Show how far the work is."""
        if sys.stderr.isatty() and time.monotonic() - self.start > _QUIET:
            click.echo(f"\r\033[K{self.what}: {text}", err=True, nl=False)
            self.shown = True

    def close(self) -> None:
        """Clear the line."""
        if self.shown:
            click.echo("\r\033[K", err=True, nl=False)

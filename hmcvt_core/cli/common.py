# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the commands share: options, answers, progress."""

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import reduce, wraps
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import click

from ..files import data_path, plain
from ..files.bench import BenchSamples
from ..files.tables.numbers import parsed
from ..files.tables.units import UNITS
from ..model.agreement import LOADS, STROKES, operating_point
from ..model.domain import AXES
from ..model.model import FORMULATIONS, EfficiencyModel
from ..model.parameter_file import load_model, load_stage
from ..physics.effects import Effect, load_effects
from ..physics.effects.base import OIL_HOOKS
from ..report.style import check_drawable, picture_format
from ..transmission.stage import Stage

Function = TypeVar("Function", bound=Callable[..., Any])
_QUIET = 2.0  # seconds of work before progress is shown


class Answer(NamedTuple):
    """What a command found: plain data for --json, lines for people, and its exit code."""

    value: Any
    lines: Sequence[str] = ()
    code: int = 0


def answers(function: Callable[..., Answer]) -> Callable[..., int]:
    """Add --json to a command, and print what it returns."""

    @json_option
    @wraps(function)
    def command(*, as_json: bool, **given: Any) -> int:
        found = function(**given)
        if as_json:
            print_json(found.value)
        elif found.lines:
            click.echo("\n".join(found.lines))
        return found.code

    return command


def command(
    name: str, examples: str, *shared: Callable[[Any], Any]
) -> Callable[[Callable[..., Answer]], click.Command]:
    """Declare a command that gives an answer, with options that it shares with others.

    They stand in --help behind its own.
    """

    def declare(function: Callable[..., Answer]) -> click.Command:
        own = function.__dict__.pop("__click_params__", [])
        found = click.command(name, epilog=f"\b\nExamples:{examples}")(
            options(*shared)(answers(function))
        )
        found.params[:0] = reversed(own)
        return found

    return declare


class OutputFile(click.ParamType):  # type: ignore[type-arg]
    """A file to write, refused before the work rather than after it when that cannot be done.

    `check` refuses paths besides.
    """

    name = "file"

    def __init__(self, check: Callable[[str], object] = str) -> None:
        self.check = check

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Return the path."""
        path = Path(value)
        if path.is_dir():
            self.fail(f"{value}: is a folder", param, ctx)
        made = path.is_file() or not path.exists()  # not such as /dev/null
        if made and not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
            self.fail(
                f"{value}: {path.parent} is not a folder that can be written",
                param,
                ctx,
            )
        self.check(str(value))
        return str(value)


def _fractions(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not a list of numbers such as 0.98,0.97"
        ) from None


picture_option = click.option(
    "--picture",
    type=OutputFile(picture_format),
    metavar="FILE",
    help="Draw it; the ending (.png, .svg, .html) names the format.",
)
report_option = click.option(
    "--report",
    type=OutputFile(lambda _: check_drawable()),
    metavar="R.html",
    help="Write the report page.",
)
json_option = click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print one JSON value and nothing else on stdout.",
)
seed_option = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the random numbers.",
)


def options(*given: Callable[[Any], Any]) -> Callable[[Function], Function]:
    """Return several options as one; they stand in --help in this order."""
    return lambda function: reduce(
        lambda done, option: option(done), reversed(given), function
    )


# What is identified; `gears` are gear efficiencies to compare.
model_options = options(
    click.option(
        "--formulation",
        type=click.Choice(FORMULATIONS),
        default="power_balance",
        show_default=True,
        help="Equations to use.",
    ),
    click.option(
        "--gear-efficiency",
        "gears",
        type=_fractions,
        multiple=True,
        metavar="0.98[,0.97...]",
        callback=lambda *given: list(chain(*given[-1])),
        help="Of every gear pair; several are compared and the best is kept.",
    ),
    click.option(
        "--transmission",
        metavar="T.yaml",
        help="Gear train; the paper's when left out.",
    ),
    click.option("--stage", metavar="NAME", help="Stage of the transmission file."),
)


def _load(_: click.Context, __: click.Parameter, sources: tuple[str, ...]) -> None:
    for source in sources:
        load_effects(source)


effects_option = click.option(
    "--effects",
    metavar="MODULE",
    multiple=True,
    expose_value=False,
    callback=_load,
    help="Module or Python file with effects of your own, which is run.",
)


# The model, and the effects that it may hold besides those of hmcvt.
params_option = options(
    click.option(
        "--params",
        metavar="P.yaml",
        help="Parameter file of the model; the shipped params/hm4.yaml when left out.",
    ),
    effects_option,
)


class Point(NamedTuple):
    """An operating point."""

    displacement_ratio: float
    engine_speed: float
    load_torque: float
    oil_temperature: float | None = None


def _reader(
    name: str, example: str, units: Mapping[str, float]
) -> Callable[[Any], float]:
    """Return what reads a number in the SI unit, or in one of the `units` written behind it.

    A decimal comma is taken where no point stands. A complaint says `name`, which stands in --help
    too, and `example`.
    """

    def read(text: str | float) -> float:
        value, unit = parsed(str(text).strip(), comma="." not in str(text))
        if unit in ("", *units) and (
            value == value or str(text).strip().lower() == "nan"
        ):
            return units.get(unit, 1.0) * value
        raise click.BadParameter(f"{text!r} is not a {name}: write {example}")

    read.__name__ = name
    return read


speed = _reader("speed", "146.6 (rad/s) or 1400rpm", UNITS["engine_speed"])
torque = _reader("torque", "200 (N m) or 1.2kNm", UNITS["engine_torque"])
power = _reader("power", "40000 (W) or 40kW", UNITS["engine_power"])
fraction = _reader("fraction", "0.5 or 50%", UNITS["efficiency"])
noise_option = click.option(
    "--noise",
    type=fraction,
    metavar="STD",
    help="Standard deviation of the efficiency, 0.004 or 0.4%.  [default: "
    "column efficiency_std, else repeated points, else 1.12 % of the efficiency]",
)


def part_up_to(highest: float) -> Callable[[click.Context, click.Parameter, Any], Any]:
    """Return a callback that refuses a fraction that is not above 0 and at most `highest`."""

    def checked(
        _: click.Context, __: click.Parameter, value: float | None
    ) -> float | None:
        if value is None or 0.0 < value <= highest:
            return value
        raise click.BadParameter(f"{value:g} is not above 0 and at most {highest:g}")

    return checked


def _output_speed(
    ctx: click.Context, _: click.Parameter, value: str | None
) -> float | None:
    """Read an output speed as `speed` does; one in km/h by tyre and final drive."""
    sizes = ctx.params["tyre_radius"], ctx.params["final_drive"]
    if value is None or not value.strip().lower().endswith("km/h"):
        if any(size is not None for size in sizes):
            raise click.UsageError(
                "--tyre-radius and --final-drive are for an --output-speed in km/h"
            )
        return None if value is None else speed(value)
    if not all(size is not None and size > 0.0 for size in sizes):
        raise click.UsageError(
            "--output-speed in km/h needs --tyre-radius and --final-drive"
        )
    driven, _unit = parsed(
        value.lower().replace("km/h", "").strip(), comma="." not in value
    )
    if math.isnan(driven):
        raise click.BadParameter(f"{value!r} is not a speed: write 8km/h")
    return driven / 3.6 / sizes[0] * float(sizes[1])


# What meters show at either shaft.
measured_options = options(
    click.option(
        "--output-speed",
        metavar="SPEED",
        callback=_output_speed,
        help="Of the output shaft: rad/s, 1200rpm; or 8km/h with the next two.",
    ),
    click.option(
        "--tyre-radius",
        type=float,
        is_eager=True,
        help="Rolling radius in m, for km/h.",
    ),
    click.option(
        "--final-drive",
        type=float,
        is_eager=True,
        help="Output shaft speed / wheel speed, for km/h.",
    ),
    click.option("--output-power", type=power, help="In W or like 40kW."),
    click.option("--output-torque", type=torque, help="Of the output shaft in N m."),
    click.option(
        "--load-torque", type=torque, help="Output power / engine speed in N m."
    ),
    click.option("--engine-torque", type=torque, help="Of the engine in N m."),
)
stage_option = click.option(
    "--stage", metavar="NAME", help="Stage engaged, of several."
)
# One operating point, None where left out; see `point_from`.
point_options = options(
    click.option(
        "--displacement-ratio",
        type=fraction,
        help="Pump stroke, -1 to 1 or in %; or give --output-speed.",
    ),
    click.option("--engine-speed", type=speed, help="In rad/s, or like 1400rpm."),
    measured_options,
    click.option("--oil-temperature", type=float, help="Oil temperature in deg C."),
)


def point_from(given: Mapping[str, Any], model: EfficiencyModel) -> Point:
    """Return the operating point that options give, with what a meter shows turned into it."""
    if given["engine_speed"] is None:
        raise click.UsageError("--engine-speed is needed")
    for names in (STROKES, LOADS):
        if sum(given[name] is not None for name in names) != 1:
            options = ", ".join(f"--{name.replace('_', '-')}" for name in names)
            raise click.UsageError(f"one of {options} is needed, and one only")
    stroke, load = operating_point(
        model, given["engine_speed"], {name: given[name] for name in (*STROKES, *LOADS)}
    )
    return Point(stroke, given["engine_speed"], load, given["oil_temperature"])


def one_of(what: str, **given: Any) -> None:
    """Raise a usage error where several options are given that do the same."""
    names = [
        f"--{name.replace('_', '-')}"
        for name, value in given.items()
        if value is not None
    ]
    if len(names) > 1:
        raise click.UsageError(f"{' and '.join(names)} both {what}: give one")


def keep_inputs(inputs: Iterable[str | None], outputs: Iterable[str | None]) -> None:
    """Raise a usage error where a command would write over a file that it reads."""
    read = [Path(name).resolve() for name in inputs if name is not None]
    for name in outputs:
        if name is not None and Path(name).resolve() in read:
            raise click.UsageError(
                f"{name}: is read by this command; write another file"
            )


def model_from(path: str | None) -> EfficiencyModel:
    """Load the model asked for, or the shipped one."""
    return load_model(data_path("params/hm4.yaml") if path is None else path)


def stage_from(path: str | None, stage: str | None) -> EfficiencyModel:
    """Load the model of one stage; its name may be left out where the file holds one."""
    model = model_from(path)
    if stage is None and len(model.stages) > 1:
        raise click.UsageError(
            f"{path} holds {', '.join(model.stages)}: --stage is needed"
        )
    return model if stage is None else model.in_stage(stage)


def gear_train(
    params: str | None, transmission: str | None, stage: str | None
) -> tuple[list[Stage], tuple[Effect, ...]]:
    """Return the stages of a parameter file and its effects, or the one of a transmission file."""
    if params is None:
        return [
            load_stage(transmission or data_path("params/transmission.yaml"), stage)
        ], ()
    if transmission is not None or stage is not None:
        raise click.UsageError(
            "--params holds a gear train: leave --transmission and --stage out"
        )
    model = load_model(params)
    return [each.stage for each in model.stages.values()], model.effects


def note_oil_temperature(
    model: EfficiencyModel, oil_temperature: float | None = None
) -> None:
    """Say on stderr that a temperature given does nothing, or that one is assumed."""
    used = any(effect.acts_at(*OIL_HOOKS) for effect in model.effects)
    if oil_temperature is not None and not used:
        click.echo(
            "note: this model has no effect of the oil temperature; --oil-temperature "
            "changes nothing",
            err=True,
        )
    elif oil_temperature is None and used:
        click.echo(
            "note: this model depends on the oil temperature; the answer holds at that of "
            "its identification, 60 deg C",
            err=True,
        )


def domain_told(
    model: EfficiencyModel, point: Point, which: str = ""
) -> tuple[bool | None, list[str]]:
    """Tell whether a point lies within the data of the model, and in words where it does not.

    None if the model does not know them.
    """
    if model.domain is None:
        return None, ["the model does not say what range of data it comes from"]
    left = [f"  {departure}" for departure in model.domain.departures(*point[:3])]
    return not left, left and [
        f"{which}outside the range of the data that the model was identified from:",
        *left,
    ]


def print_json(value: Any) -> None:
    """Print plain data as JSON; NaN and infinity become null."""
    click.echo(json.dumps(plain(value), indent=1, allow_nan=False))


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return right-aligned columns."""
    lines = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in lines
    )


def _number(value: float, form: str, unit: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:{form}}{unit}"


def sample_records(
    model: EfficiencyModel, samples: BenchSamples, numbers: Sequence[int] = ()
) -> list[dict[str, Any]]:
    """Return one record per sample; `error` is (predicted - measured) / measured.

    `numbers` are those of the samples in their file; 1, 2, ... when left out.
    """
    found = model.predict(*samples.points)
    columns = {
        "sample": numbers or range(1, len(samples) + 1),
        **{axis: getattr(samples, axis).tolist() for axis in AXES},
        "measured": samples.efficiency.tolist(),
        "predicted": found.efficiency.tolist(),
        "standard_error": found.standard_error.tolist(),
        # None, not false, for a model that does not say what data it comes from.
        "inside_domain": found.inside_domain.tolist()
        if model.domain
        else [None] * len(samples),
        "error": (
            (found.efficiency - samples.efficiency) / samples.efficiency
        ).tolist(),
    }
    return [
        dict(zip(columns, row, strict=True))
        for row in zip(*columns.values(), strict=True)
    ]


def sample_table(records: Sequence[dict[str, Any]]) -> str:
    """Return the records as a table; `-` where the model has no answer."""
    domain = {True: "inside", False: "outside", None: "unknown"}
    head = (
        "sample",
        "ratio [-]",
        "engine [rad/s]",
        "load [N m]",
        "measured",
        "predicted",
        "std error",
        "error",
        "domain",
    )
    return table(
        head,
        [
            (
                str(entry["sample"]),
                f"{entry['displacement_ratio']:.3f}",
                f"{entry['engine_speed']:.2f}",
                f"{entry['load_torque']:.2f}",
                f"{entry['measured']:.4f}",
                _number(entry["predicted"], ".4f"),
                _number(entry["standard_error"], ".4f"),
                _number(100 * entry["error"], "+.2f", " %"),
                domain[entry["inside_domain"]],
            )
            for entry in records
        ],
    )


class Progress(AbstractContextManager["Progress"]):
    """A line on stderr for work that takes over two seconds.

    On a terminal only, unless `every` so many seconds a line is told elsewhere too.
    """

    def __init__(self, what: str, every: float = math.inf) -> None:
        self.what, self.every, self.shown = what, every, False
        self.start = self.told = time.monotonic()

    def seconds(self) -> float:
        """Return how long the work has taken."""
        return time.monotonic() - self.start

    def __call__(self, text: str) -> None:
        """Show how far the work is."""
        if sys.stderr.isatty():
            if self.seconds() > _QUIET:
                click.echo(f"\r\033[K{self.what}: {text}", err=True, nl=False)
                self.shown = True
        elif time.monotonic() - self.told > self.every:
            self.told = time.monotonic()
            click.echo(f"{self.what}: {text}", err=True)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Clear the line."""
        if self.shown:
            click.echo("\r\033[K", err=True, nl=False)

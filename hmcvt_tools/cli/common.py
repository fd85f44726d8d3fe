# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the commands share: how they answer, their options, and the models they load."""

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import click

from hmcvt_core.files import data_path, plain
from hmcvt_core.model.model import FORMULATIONS, EfficiencyModel
from hmcvt_core.model.oil import without_oil_temperature
from hmcvt_core.model.operating_point import LOADS, STROKES, operating_point
from hmcvt_core.model.parameter_file import load_model, load_stage, load_stages
from hmcvt_core.physics.effects import Effect, load_effects
from hmcvt_core.transmission.stage import Stage

from ..report.style import picture_format, report_format
from .outputs import Output, write_outputs
from .progress import Progress
from .quantities import (
    fraction,
    fractions,
    number,
    output_speed,
    part_up_to,
    power,
    speed,
    torque,
)
from .samples import sample_records, sample_table, table

__all__ = [
    "Answer",
    "Output",
    "OutputFile",
    "Point",
    "Progress",
    "answers",
    "command",
    "fraction",
    "number",
    "options",
    "part_up_to",
    "power",
    "print_json",
    "sample_records",
    "sample_table",
    "speed",
    "table",
    "torque",
]

Function = TypeVar("Function", bound=Callable[..., Any])
Option = Callable[[Any], Any]


class Answer(NamedTuple):
    """Result of a command.

    Attributes:
        value: plain data for --json.
        lines: text for people.
        code: exit code.
        outputs: files to write once the answer is printed.
    """

    value: Any
    lines: Sequence[str] = ()
    code: int = 0
    outputs: Sequence[Output] = ()


def answers(function: Callable[..., Answer]) -> Callable[..., int]:
    """Add --json to a command, and print what it returns."""

    @json_option
    @wraps(function)
    def printing(*, as_json: bool, **arguments: Any) -> int:
        answer = function(**arguments)
        if as_json:
            print_json(answer.value)
        elif answer.lines:
            click.echo("\n".join(answer.lines))
        failure = write_outputs(answer.outputs, quiet=as_json)
        return failure or answer.code

    return printing


def command(
    name: str, examples: str, *shared: Option
) -> Callable[[Callable[..., Answer]], click.Command]:
    """Return a decorator that declares a command which returns an `Answer`.

    Args:
        name: of the command.
        examples: lines below --help.
        shared: options shared with other commands; --help lists them after its particular ones.
    """

    def declare(function: Callable[..., Answer]) -> click.Command:
        # click collects options in this attribute, the last one first.
        particular = function.__dict__.pop("__click_params__", [])
        with_shared = options(*shared)(answers(function))
        declared = click.command(name, epilog=f"\b\nExamples:{examples}")(with_shared)
        declared.params = [*reversed(particular), *declared.params]
        return declared

    return declare


class OutputFile(click.ParamType):  # type: ignore[type-arg]
    """A file to write, which is refused before the work starts if it cannot be written.

    Args:
        check: raises for further paths to refuse.
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
        # A device such as /dev/null needs no folder that can be written.
        is_device = path.exists() and not path.is_file()
        folder = path.parent
        writable = folder.is_dir() and os.access(folder, os.W_OK)
        if not (is_device or writable):
            self.fail(
                f"{value}: {folder} is not a folder that can be written", param, ctx
            )
        self.check(str(value))
        return str(value)


picture_option = click.option(
    "--picture",
    type=OutputFile(picture_format),
    metavar="FILE",
    help="Draw it; the ending (.png, .svg, .pdf, .html) names the format.",
)
report_option = click.option(
    "--report",
    type=OutputFile(report_format),
    metavar="R.html|R.pdf",
    help="Write the report: the page (.html), or one sheet of it (.pdf).",
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


def options(*several: Option) -> Callable[[Function], Function]:
    """Return several options as one decorator; --help lists them in this order."""

    def decorate(function: Function) -> Function:
        for option in reversed(several):
            function = option(function)
        return function

    return decorate


def _flattened(
    _: click.Context, __: click.Parameter, values: tuple[list[float], ...]
) -> list[float]:
    flat = []
    for value in values:
        flat += value
    return flat


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
        type=fractions,
        multiple=True,
        metavar="0.98[,0.97...]",
        callback=_flattened,
        help="Of every gear pair; several are compared and the best is kept.",
    ),
    click.option(
        "--transmission",
        metavar="T.yaml",
        help="Gear train; the paper's when left out.",
    ),
    click.option("--stage", metavar="NAME", help="Stage of the transmission file."),
)


def _load(
    _: click.Context, __: click.Parameter, sources: tuple[str, ...]
) -> tuple[str, ...]:
    for source in sources:
        load_effects(source)
    return sources


def _effects_option(pass_on: bool) -> Option:
    return click.option(
        "--effects",
        metavar="MODULE",
        multiple=True,
        expose_value=pass_on,
        callback=_load,
        help="Module or Python file with effects that you define; it is run.",
    )


effects_option = _effects_option(pass_on=False)
# For commands whose worker processes load the effects too.
effects_passed_on_option = _effects_option(pass_on=True)

# The model, and effects that it may hold in addition to those of hmcvt.
params_option = options(
    click.option(
        "--params",
        metavar="P.yaml",
        help="Parameter file of the model; the shipped params/hm4.yaml when left out.",
    ),
    effects_option,
)
noise_option = click.option(
    "--noise",
    type=fraction,
    metavar="STD",
    help="Standard deviation of the efficiency, 0.004 or 0.4% for 0.4 points.  [default: "
    "column efficiency_std, else repeated points, else 1.12 % of the efficiency]",
)
# What meters show at either shaft.
measured_options = options(
    click.option(
        "--output-speed",
        metavar="SPEED",
        callback=output_speed,
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


class Point(NamedTuple):
    """An operating point.

    Attributes:
        displacement_ratio: pump stroke [-].
        engine_speed: [rad/s].
        load_torque: output power / engine speed [N m].
        oil_temperature: [deg C], or None.
    """

    displacement_ratio: float
    engine_speed: float
    load_torque: float
    oil_temperature: float | None = None


def flag(name: str) -> str:
    """Return a parameter's name as it is written on the command line."""
    return f"--{name.replace('_', '-')}"


def point_from(given: Mapping[str, Any], model: EfficiencyModel) -> Point:
    """Return the operating point that options state, solved from meter readings if need be.

    Args:
        given: values of `point_options` by name.
        model: relates the readings of the meters to stroke and load.

    Raises:
        click.UsageError: the options state too little or too much.
    """
    engine_speed = given["engine_speed"]
    if engine_speed is None:
        raise click.UsageError("--engine-speed is needed")
    for names in (STROKES, LOADS):
        stated = [name for name in names if given[name] is not None]
        if len(stated) != 1:
            choices = ", ".join(map(flag, names))
            raise click.UsageError(f"one of {choices} is needed, and one only")
    readings = {name: given[name] for name in (*STROKES, *LOADS)}
    stroke, load = operating_point(model, engine_speed, readings)
    return Point(stroke, engine_speed, load, given["oil_temperature"])


def one_of(what: str, **given: Any) -> None:
    """Raise a usage error where several options are given that do the same."""
    names = [flag(name) for name, value in given.items() if value is not None]
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
    """Load a model; the shipped one when no path is given."""
    if path is None:
        return load_model(data_path("params/hm4.yaml"))
    return load_model(path)


def stage_from(path: str | None, stage: str | None) -> EfficiencyModel:
    """Load the model of one stage; its name may be left out where the file holds one."""
    model = model_from(path)
    if stage is not None:
        return model.in_stage(stage)
    if len(model.stages) > 1:
        raise click.UsageError(
            f"{path} holds {', '.join(model.stages)}: --stage is needed"
        )
    return model


def gear_train(
    params: str | None, transmission: str | None, stage: str | None
) -> tuple[list[Stage], tuple[Effect, ...]]:
    """Return the stages to identify and the effects that act in them.

    Args:
        params: parameter file, whose stages are all taken.
        transmission: transmission file, whose stages are all taken unless `stage` names one.
        stage: name of a stage of the transmission file.
    """
    if params is None:
        if transmission is None:
            path = data_path("params/transmission.yaml")
            return [load_stage(path, stage)], ()
        if stage is not None:
            return [load_stage(transmission, stage)], ()
        return list(load_stages(transmission)), ()
    if transmission is not None or stage is not None:
        raise click.UsageError(
            "--params holds a gear train: leave --transmission and --stage out"
        )
    model = load_model(params)
    return [part.stage for part in model.stages.values()], model.effects


def note_oil_temperature(
    model: EfficiencyModel, oil_temperature: float | None = None
) -> None:
    """Print on stderr that a given temperature has no effect, or what is assumed without one."""
    clauses = without_oil_temperature(model.effects)
    if oil_temperature is not None and not clauses:
        click.echo(
            "note: this model has no effect of the oil temperature; --oil-temperature "
            "changes nothing",
            err=True,
        )
    if oil_temperature is None and clauses:
        click.echo(
            f"note: without an oil temperature, {', '.join(clauses)}",
            err=True,
        )


def domain_lines(
    model: EfficiencyModel, point: Point, prefix: str = ""
) -> tuple[bool | None, list[str]]:
    """Return whether a point lies within the data of the model, and lines where it does not.

    Args:
        model: states the range of its data, or does not.
        point: operating point.
        prefix: put before the first line.

    Returns:
        True, False, or None if the model does not state the range; lines for people.
    """
    if model.domain is None:
        return None, ["the model does not say what range of data it comes from"]
    departures = model.departures(*point[:4])
    if not departures:
        return True, []
    lines = [
        f"{prefix}outside the range of the data that the model was identified from:"
    ]
    lines += [f"  {departure}" for departure in departures]
    return False, lines


def print_json(value: Any) -> None:
    """Print plain data as JSON; NaN and infinity become null."""
    click.echo(json.dumps(plain(value), indent=1, allow_nan=False))

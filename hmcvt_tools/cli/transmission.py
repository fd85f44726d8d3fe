# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt transmission new` and `hmcvt transmission check`."""

import math
from pathlib import Path

import click

from hmcvt_core.errors import InputError
from hmcvt_core.files import data_path
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import read_bench, write_bench
from hmcvt_core.model.model import typical_model
from hmcvt_core.model.parameter_file import load_stages
from hmcvt_core.model.signs import sign_problems, with_corrected_signs
from hmcvt_core.transmission.check import STROKES, TransmissionCheck, check_stages
from hmcvt_core.transmission.new_file import (
    DIRECT,
    clutch_from_text,
    commented_file,
    stage_from_text,
)
from hmcvt_core.transmission.teeth import tooth_counts

from ..report.pictures import save
from ..report.power_paths import draw_power_paths
from . import common
from .common import Answer

_STAGE_EXAMPLES = """\
A stage is its name, and what each path goes through as PATH=PAIRS:MEMBER, for example
  HM4 row=k1 mechanical=2,3:carrier pump=4 motor=-5:sun output=6,11:ring
  H0 layout=hydrostatic pump=4 motor=-5 output=8
  R row=k1 reverse=yes mechanical=-direct:ring pump=4 motor=5:sun output=6:carrier
  V layout=output_coupled row=k1 mechanical=1:carrier pump=4:ring motor=5 output=6:sun
mechanical: engine to row; pump: engine (output_coupled: row) to pump; motor: motor to row
(others: output); output: row (hydrostatic: motor) to output. A minus reverses a path, direct
stands for no gear pair."""

_NamedRatios = tuple[tuple[str, float | str], ...]

_ASSUMED_DISPLACEMENT = 55.0
"""Of pump and motor [cm3/rev], as for the paper's transmission."""
_ASSUMED_GEAR_EFFICIENCY = 0.98
"""Of every gear pair [-]; the best of the paper's Table 3."""


@click.group(
    "transmission",
    epilog="""\b
Examples:
  hmcvt transmission new my_gears.yaml
  hmcvt transmission check my_transmission.yaml""",
)
def group() -> None:
    """Write a transmission file from gear ratios or tooth counts, and check one."""


def _named_ratio(text: str) -> tuple[str, float | str]:
    """Read a name and a ratio, such as 1=1.439, 1=1,439 or, in teeth, 1=59/41."""
    name, _, value = text.partition("=")
    if name.strip() == DIRECT:
        raise click.BadParameter(f"{DIRECT!r} stands for no pair; choose another name")
    try:
        if name.strip() and tooth_counts(value) is not None:
            return name.strip(), value.strip()
    except InputError as error:
        raise click.BadParameter(f"{text!r}: {error}") from None
    try:
        number = float(value.replace(",", "."))
    except ValueError:
        number = math.nan
    if not name.strip() or not math.isfinite(number):
        raise click.BadParameter(
            f"{text!r} is not a name and a ratio: write 1=1.439, or 1=59/41 in teeth"
        )
    return name.strip(), number


@common.command(
    "new",
    """
  hmcvt transmission new my_gears.yaml
  hmcvt transmission new my_gears.yaml --gear-pair 2=0.969 --gear-pair 3=1.484 \\
      --gear-pair 4=0.678 --gear-pair 5=1.96 --gear-pair 6=0.982 --gear-pair 11=0.823 \\
      --planetary-row k1=2.56 \\
      --stage "HM4 row=k1 mechanical=2,3:carrier pump=4 motor=-5:sun output=6,11:ring\"
  hmcvt transmission new H0.yaml --gear-pair 4=0.678 --gear-pair 5=1.96 --gear-pair 8=2.767 \\
      --stage "H0 layout=hydrostatic pump=4 motor=-5 output=-8\"""",
)
@click.argument("out", metavar="T.yaml", type=common.OutputFile())
@click.option(
    "--gear-pair",
    "gear_pairs",
    type=_named_ratio,
    multiple=True,
    metavar="NAME=RATIO",
    help="Driving speed / driven speed of a pair, or teeth of the driven gear / teeth of the "
    "driving gear as 36/45; once for each pair.",
)
@click.option(
    "--planetary-row",
    "rows",
    type=_named_ratio,
    multiple=True,
    metavar="NAME=K",
    help="Teeth of the ring / teeth of the sun, as 2.56 or 128/50; once for each row.",
)
@click.option(
    "--pump-displacement",
    type=common.number,
    help=f"In cm3/rev.  [default: {_ASSUMED_DISPLACEMENT:g}, assumed]",
)
@click.option(
    "--motor-displacement",
    type=common.number,
    help=f"In cm3/rev.  [default: {_ASSUMED_DISPLACEMENT:g}, assumed]",
)
@click.option(
    "--gear-efficiency",
    type=common.fraction,
    help=f"Of every gear pair.  [default: {_ASSUMED_GEAR_EFFICIENCY:g}]",
)
@click.option(
    "--stage",
    "stages",
    multiple=True,
    metavar="TEXT",
    help="Name and paths of a stage, once for each stage; see the examples. A minus in "
    f"front of the gear pairs reverses a path, {DIRECT} stands for no pair. Asked for when left "
    "out.",
)
@click.option(
    "--clutch",
    "clutches",
    multiple=True,
    metavar="TEXT",
    help="Name of a clutch, its two sides and the stages in which it is closed, such as "
    "'C2 between=HM2.ring/6/7,output*11 closed=HM2'; the slips of open clutches follow.",
)
def new(
    out: str,
    gear_pairs: _NamedRatios,
    rows: _NamedRatios,
    pump_displacement: float | None,
    motor_displacement: float | None,
    gear_efficiency: float | None,
    stages: tuple[str, ...],
    clutches: tuple[str, ...],
) -> Answer:
    """Write a commented transmission file from gear ratios or tooth counts, and check it.

    Without --stage all that no option states is asked for.
    """
    if Path(out).exists():
        raise click.UsageError(f"{out}: exists; write another file")
    if not stages:
        gear_pairs = gear_pairs or _asked_numbers(
            "Gear pair, such as 1=1.439 or, in teeth, 1=59/41"
        )
        rows = rows or _asked_numbers("Planetary row, such as k1=2.56 or k1=128/50")
        pump_displacement = _asked(
            pump_displacement, "Pump displacement [cm3/rev]", _ASSUMED_DISPLACEMENT
        )
        motor_displacement = _asked(
            motor_displacement, "Motor displacement [cm3/rev]", _ASSUMED_DISPLACEMENT
        )
        gear_efficiency = _asked(
            gear_efficiency, "Efficiency of a gear pair", _ASSUMED_GEAR_EFFICIENCY
        )
        stages = _asked_stages()
    notes = []
    if pump_displacement is None or motor_displacement is None:
        notes.append(
            f"note: {_ASSUMED_DISPLACEMENT:g} cm3/rev is assumed for the displacement that "
            "no option states: the leakage and the pressures scale with it"
        )
    text = commented_file(
        Path(out).stem,
        dict(gear_pairs),
        dict(rows),
        (
            pump_displacement or _ASSUMED_DISPLACEMENT,
            motor_displacement or _ASSUMED_DISPLACEMENT,
        ),
        [stage_from_text(stage) for stage in stages],
        _ASSUMED_GEAR_EFFICIENCY if gear_efficiency is None else gear_efficiency,
        [clutch_from_text(clutch) for clutch in clutches],
    )
    notes += _teeth_notes(gear_pairs)
    write_atomically(Path(out), text)
    try:
        loaded = load_stages(out)
    except InputError:
        Path(out).unlink()
        raise
    check = check_stages(loaded)
    return Answer(check.to_dict(), [_report(check), *notes, f"written to {out}"])


def _teeth_notes(gear_pairs: _NamedRatios) -> list[str]:
    """Say which gear of each pair in teeth drives, as 36/45 alone does not."""
    lines = []
    for name, value in gear_pairs:
        counts = tooth_counts(value)
        if counts is not None:
            lines.append(
                f"{name}: {counts.under} teeth drive {counts.over}, the driven shaft turns "
                f"{1.0 / counts.ratio:.4g} times as fast"
            )
    return lines


def _asked_line(prompt: str) -> str:
    """Ask for a line, which may be empty.

    Raises:
        InputError: the input ends before the line.
    """
    try:
        line: str = click.prompt(prompt, default="", show_default=False, err=True)
    except click.Abort as error:
        # click raises the same for an interrupt, which needs no advice.
        if isinstance(error.__context__, KeyboardInterrupt):
            raise
        click.echo(err=True)
        raise InputError(
            f"the input ended before the answer to {prompt!r}; nothing is written"
        ) from None
    return line.strip()


def _asked(stated: float | None, prompt: str, assumed: float) -> float:
    """Return what an option states, or ask for a number until one is given."""
    if stated is not None:
        return stated
    while True:
        line = _asked_line(f"{prompt} (empty for {assumed:g})")
        if not line:
            return assumed
        try:
            return common.number(line)
        except click.BadParameter as error:
            click.echo(error.message, err=True)


def _asked_numbers(prompt: str) -> _NamedRatios:
    """Ask for names with numbers; one that cannot be read is asked again."""
    numbers: list[tuple[str, float | str]] = []
    while True:
        line = _asked_line(f"{prompt} (empty to go on)")
        if not line:
            return tuple(numbers)
        try:
            numbers.append(_named_ratio(line))
        except click.BadParameter as error:
            click.echo(error.message, err=True)


def _asked_stages() -> tuple[str, ...]:
    """Ask for stages; one that cannot be read is asked again.

    Raises:
        InputError: no stage is stated, or the input ends.
    """
    click.echo(_STAGE_EXAMPLES, err=True)
    stages: list[str] = []
    while True:
        line = _asked_line("Stage (empty to end)")
        if not line and stages:
            return tuple(stages)
        if not line:
            raise InputError("no stage is stated; nothing is written")
        try:
            stage_from_text(line)
        except InputError as error:
            click.echo(str(error), err=True)
        else:
            stages.append(line)


@common.command(
    "check",
    """
  hmcvt transmission check params/transmission.yaml
  hmcvt transmission check my_transmission.yaml --picture paths.svg --json""",
    common.picture_option,
)
@click.argument("transmission", metavar="[T.yaml]", required=False)
def check(transmission: str | None, picture: str | None) -> Answer:
    """Check a transmission file: speed ratios, slips of open clutches, and how the stages meet.

    The picture is a sketch of the power paths. The shipped file is checked when none is given.
    """
    common.keep_inputs([transmission], [picture])
    path = transmission or str(data_path("params/transmission.yaml"))
    stages = load_stages(path)
    result = check_stages(stages)
    lines = [_report(result)]
    if picture is not None:
        save(draw_power_paths, picture, stages, result)
        lines.append(f"picture written to {picture}")
    return Answer(result.to_dict(), lines)


def _report(check: TransmissionCheck) -> str:
    """Return a check as text."""
    head = ["stage", "layout"]
    head += [f"ratio at {stroke:+g}" for stroke in STROKES]
    head += ["direction", "larger stroke"]
    rows = []
    for stage in check.stages:
        ratios = [f"{ratio:.4f}" for ratio in stage.ratios]
        effect = "faster" if stage.rising else "slower"
        rows.append((stage.name, stage.layout, *ratios, stage.direction, effect))
    lines = [common.table(head, rows)]
    if check.clutches:
        lines.append(_clutch_table(check))
    for meeting in check.overlaps:
        kind = "overlap" if meeting.overlap >= 0.0 else "gap"
        lines.append(
            f"{meeting.lower} to {meeting.upper}: {meeting.lower_end:.4f} to "
            f"{meeting.upper_end:.4f}, {kind} of {100 * abs(meeting.overlap):.2f} %"
        )
    lines += [f"note: {remark}" for remark in check.remarks]
    return "\n".join(lines)


def _clutch_table(check: TransmissionCheck) -> str:
    """Return the slips of the open clutches as a table, stage by stage."""
    head = ["stage", "open clutch"]
    head += [f"slip at {stroke:+g}" for stroke in STROKES]
    rows = []
    for clutch in check.clutches:
        slips = [f"{slip:.4f}" for slip in clutch.slips]
        rows.append((clutch.stage, clutch.name, *slips))
    meaning = "slip: (speed of the first side - that of the second) / engine speed"
    return f"{common.table(head, rows)}\n{meaning}"


@common.command(
    "signs",
    """
  hmcvt transmission signs stages.csv --transmission stages.yaml --out corrected.csv
  hmcvt transmission signs stages.csv --params stages_model.yaml --json""",
)
@click.argument("bench", metavar="BENCH.csv")
@click.option(
    "--transmission", metavar="T.yaml", help="Transmission file of the machine."
)
@click.option("--params", metavar="P.yaml", help="Parameter file of the machine.")
@click.option(
    "--out",
    type=common.OutputFile(),
    metavar="CORRECTED.csv",
    help="Write the bench file with corrected signs.",
)
def signs(
    bench: str, transmission: str | None, params: str | None, out: str | None
) -> Answer:
    """Check the signs of output speed and pressure, stage by stage, and correct them.

    Bench files state the output speed negative backward, and the pressure as high less low side of
    the motor with the sign of the output. A speed without sense, and a pressure as port A less
    port B, are recognised by gear train and load; --out writes the file with their signs corrected.
    """
    common.one_of("name the machine", transmission=transmission, params=params)
    common.keep_inputs([bench, transmission, params], [out])
    stages, effects = common.gear_train(params, transmission, None)
    model = typical_model(stages, effects)
    corrected, found = with_corrected_signs(model, read_bench(bench))
    rows = [
        (item.stage, str(item.samples), item.output_speed, item.pressure)
        for item in found
    ]
    lines = [common.table(["stage", "samples", "output speed", "pressure"], rows)]
    problems = sign_problems(found)
    lines += [f"note: {problem}" for problem in problems]
    if out is not None:
        write_bench(out, corrected)
        lines.append(f"{len(corrected)} samples written to {out}")
    value = {"stages": [item.to_dict() for item in found], "problems": problems}
    return Answer(value, lines)


group.add_command(new)
group.add_command(check)
group.add_command(signs)

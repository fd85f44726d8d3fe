# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt diagnose`, `next`, `separable`, `watch` and `unit`: the gap between model and bench."""

from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import click

from hmcvt_core.benches import transmission
from hmcvt_core.benches.unit import UnitChange, UnitDiagnosis, diagnose_unit, put_into
from hmcvt_core.benches.unit.samples import KINDS, UnitSamples
from hmcvt_core.diagnosis import Diagnosis
from hmcvt_core.diagnosis.results.sentences import handed_over
from hmcvt_core.files.bench import BenchSamples, read_bench
from hmcvt_core.model.parameter_file import save_model
from hmcvt_core.monitoring import FALSE_ALARMS
from hmcvt_core.monitoring import watch as watch_samples
from hmcvt_core.transmission.quantities import PREDICTED

from ..logs.opening import is_log
from ..report import write_report
from ..report.gap_map import draw_gap
from ..report.pictures import save
from ..tables.unit_table import AXES, read_unit
from . import common, logs
from .common import Answer, Output
from .gap_cost import cycle_from, with_gap_cost
from .logs import OPEN

_READ_TOO = common.options(
    *(
        click.option(
            f"--{channel.name.replace('_', '-')}",
            is_flag=True,
            help=f"As if this were read too: {channel.meaning}.",
        )
        for channel in PREDICTED
        if not channel.required
    )
)
"""Options for the channels that a bench may lack."""
READERS = "hmcvt.readers"
"""Entry points that read bench samples from other files: ending (or `folder`) = function(path)."""


@common.command(
    "diagnose",
    """
  hmcvt diagnose data/table2.csv
  hmcvt diagnose bench.csv --noise 0.004 --report report.html
  hmcvt diagnose bench.csv --noise 0.004 --report report.pdf --picture gap.png
  hmcvt diagnose bench.csv --holdout later.csv --save-model params/diagnosed.yaml --json
  hmcvt diagnose bench.csv --baseline commissioned.csv --noise 0.004 --json
  hmcvt diagnose data/simulated.csv --noise 0.004 --mission transport""",
    common.params_option,
    common.noise_option,
    common.report_option,
    common.picture_option,
    common.seed_option,
)
@click.argument("bench", metavar="BENCH.csv")
@click.option(
    "--holdout",
    metavar="H.csv",
    help="Samples to measure the shrinkage on; cross-validation when left out.",
)
@click.option(
    "--baseline",
    metavar="SOUND.csv",
    help="The same transmission when it was sound, or a sister: only what has changed since is "
    "diagnosed.",
)
@click.option(
    "--save-model",
    "saved",
    type=common.OutputFile(),
    metavar="P.yaml",
    help="Write the model that predicts held-out samples best; see --empirical.",
)
@click.option(
    "--empirical/--no-empirical",
    default=True,
    show_default=True,
    help="With --save-model: add what the effects leave as a smooth empirical remainder, where "
    "that predicts held-out samples better.",
)
@click.option(
    "--mission",
    metavar="CYCLE.csv",
    help="Work cycle, or the name of a shipped one: what the gap costs on it, in fuel.",
)
def diagnose(
    bench: str,
    params: str | None,
    holdout: str | None,
    baseline: str | None,
    noise: float | None,
    report: str | None,
    picture: str | None,
    saved: str | None,
    empirical: bool,
    mission: str | None,
    seed: int,
) -> Answer:
    """Diagnose the gap: where it lies, which effect causes it, how far it shrinks.

    With --baseline the sound transmission is fitted first and held, and only the change is
    diagnosed.
    """
    common.keep_inputs([bench, holdout, baseline], [report, picture, saved])
    common.keep_inputs([params], [report, picture])
    model = common.model_from(params)
    samples = read_bench(bench)
    held_out = None if holdout is None else read_bench(holdout)
    sound = None if baseline is None else read_bench(baseline)
    # Read first, so that a wrong file is refused before the work.
    cycle = None if mission is None else cycle_from(mission)
    with common.Progress("diagnosis") as progress:
        diagnosis = transmission.diagnose(
            model,
            samples,
            held_out,
            noise=noise,
            seed=seed,
            progress=progress,
            baseline=sound,
        )
    lines = []
    if saved is not None:
        if not empirical and diagnosis.delivered.bumps:
            diagnosis = transmission.without_remainder(diagnosis)
        save_model(diagnosis.model, saved)
        lines.append(f"model{_contents(diagnosis)} written to {saved}")
    answer = diagnosis_answer(diagnosis, report, picture, lines)
    if cycle is None:
        return answer
    return with_gap_cost(answer, diagnosis, model, cycle)


def diagnosis_answer(
    diagnosis: Diagnosis | UnitDiagnosis | UnitChange,
    report: str | None,
    picture: str | None,
    lines: list[str],
) -> Answer:
    """Return the answer of a diagnosis, with the files to write once it is printed."""
    outputs = []
    if picture is not None:
        draw = partial(save, draw_gap, picture, diagnosis)
        outputs.append(Output("picture", picture, draw))
    if report is not None:
        write = partial(write_report, diagnosis, report)
        outputs.append(Output("report", report, write))
    return Answer(
        diagnosis.to_dict(), [diagnosis.report(), *lines], outputs=tuple(outputs)
    )


def _contents(diagnosis: Diagnosis) -> str:
    """Return in words what the saved model holds, and its error at held-out samples."""
    delivered = diagnosis.delivered
    added = handed_over(diagnosis)
    if not added:
        return " without an effect"
    before = 100.0 * delivered.rmse_before
    after = 100.0 * delivered.rmse_after
    errors = f"{before:.2f} -> {after:.2f} points rms at held-out samples"
    return f" with {added} ({errors})"


@common.command(
    "next",
    """
  hmcvt next bench.csv --noise 0.004
  hmcvt next bench.csv --limits plan.csv --json""",
    common.params_option,
    common.noise_option,
    common.seed_option,
)
@click.argument("bench", metavar="BENCH.csv")
@click.option(
    "--limits",
    metavar="PLAN.csv",
    help="The tests that can be run; the working range when left out.",
)
def next_test(
    bench: str, params: str | None, noise: float | None, limits: str | None, seed: int
) -> Answer:
    """Choose the next bench test, the one that reveals most about the gap, or say why to stop."""
    model = common.model_from(params)
    possible = None
    if limits is not None:
        possible = transmission.read_plan(limits, model)
    advice = transmission.next_test(
        model, read_bench(bench), noise=noise, possible=possible, seed=seed
    )
    return Answer(advice.to_dict(), [advice.report()])


@common.command(
    "separable",
    """
  hmcvt separable data/table2.csv
  hmcvt separable plan.csv --noise 0.004 --output-speed""",
    common.noise_option,
    common.params_option,
)
@click.argument("plan", metavar="PLAN.csv")
@_READ_TOO
@click.option("--matrix", is_flag=True, help="Print every pair as a number too.")
def separable(
    plan: str,
    noise: float | None,
    matrix: bool,
    params: str | None,
    **read_too: bool,
) -> Answer:
    """Report which effects a test plan can show and distinguish, before any test is run.

    PLAN.csv needs displacement_ratio, engine_speed and load_torque; an efficiency in it is not
    used. Further columns, such as oil_temperature, count as read.
    """
    model = common.model_from(params)
    channels = [name for name, is_read in read_too.items() if is_read]
    points = transmission.read_plan(plan, model, channels)
    isolability = transmission.separable(model, points, noise=noise)
    return Answer(isolability.to_dict(), [isolability.report(matrix)])


@common.command(
    "watch",
    """
  hmcvt watch samples.csv
  hmcvt watch samples.csv --params mine.yaml --noise 0.01 --json
  hmcvt watch drive.mf4 --params params/tractor.yaml --engine params/engine.yaml""",
    logs.options_of_logs,
    common.params_option,
    common.noise_option,
)
@click.argument("samples", metavar="SAMPLES")
@click.option(
    "--false-alarms",
    type=common.fraction,
    callback=common.part_up_to(0.5),
    show_default=True,
    default=FALSE_ALARMS,
    help="Chance of one in a whole stream, however long.",
)
@click.option(
    "--engine",
    metavar="E.yaml",
    help="Fuel map, for the log of a machine that states fuel and engine torque.",
)
def watch(
    samples: str,
    params: str | None,
    noise: float | None,
    false_alarms: float,
    engine: str | None,
    **of_logs: Any,
) -> Answer:
    """Report whether a gap has opened between model and bench, since when and how large.

    SAMPLES is a bench file, a bag where hmcvt_ros is installed, or a log (MDF4, TDMS, CAN); its
    samples are taken one by one, by their stamps where they have any. A log without output torque
    is watched within what a bus can tell: fuel against engine torque, and the slip of the output.
    Exit code 4 when a gap has opened, else 0.
    """
    model = common.model_from(params)
    if is_log(samples):
        return logs.watch_command(samples, model, engine, noise, false_alarms, of_logs)
    logs.refuse_options_of_logs(of_logs)
    if engine is not None:
        raise click.UsageError("--engine is for the log of a machine")
    opening = watch_samples(
        model, _read(samples), noise=noise, false_alarms=false_alarms
    )
    code = OPEN if opening.open else 0
    return Answer(opening.to_dict(), [opening.report()], code)


def _read(path: str) -> BenchSamples:
    """Read bench samples with the reader that is installed for the kind of file."""
    kind = Path(path).suffix.removeprefix(".")
    if Path(path).is_dir():
        kind = "folder"
    for entry in entry_points(group=READERS, name=kind):
        samples: BenchSamples = entry.load()(path)
        return samples
    return read_bench(path)


def _band(text: str) -> tuple[str, float]:
    """Read an axis and a part of its range, such as pressure=0.7."""
    axis, _, part = text.partition("=")
    if axis not in AXES:
        raise click.BadParameter(
            f"{axis!r} is none of {', '.join(AXES)}: write pressure=0.7"
        )
    return axis, common.fraction(part)


@common.command(
    "unit",
    """
  hmcvt unit pump.csv
  hmcvt unit table.csv --kind motor --unit S4D --above pressure=0.7 --json
  hmcvt unit pump.csv --report pump.html --into params/tractor.yaml
  hmcvt unit pump.csv --baseline commissioning.csv --json""",
    common.report_option,
    common.effects_option,
    common.seed_option,
)
@click.argument("table", metavar="UNIT.csv")
@click.option(
    "--kind", type=click.Choice(KINDS), help="Of the unit, where no column says so."
)
@click.option(
    "--unit",
    "name",
    metavar="NAME",
    help="Which one, where column `unit` names several.",
)
@click.option(
    "--displacement",
    metavar="NUMBER:UNIT",
    help="Of the unit at full stroke, as 56:cm3; a column of displacements that differ "
    "then gives the stroke.",
)
@click.option("--holdout", metavar="H.csv", help="Samples to measure the shrinkage on.")
@click.option(
    "--baseline",
    metavar="SOUND.csv",
    help="The same unit when it was sound, or a sister: only what has changed since is "
    "diagnosed.",
)
@click.option(
    "--above",
    type=_band,
    metavar="AXIS=PART",
    help="Hold out what lies above such a part of the highest pressure, speed or "
    "displacement_ratio, and predict it: pressure=0.7.",
)
@click.option(
    "--noise",
    type=common.fraction,
    metavar="STD",
    help="Standard deviation of flow and torque, as a part of the ideal ones.  [default: "
    "0.0034, by class A of ISO 4409]",
)
@click.option(
    "--into",
    type=common.OutputFile(),
    metavar="TRACTOR.yaml",
    help="Put parameters and effects of this unit into a transmission's file.",
)
def unit(
    table: str,
    kind: str | None,
    name: str | None,
    displacement: str | None,
    holdout: str | None,
    baseline: str | None,
    above: tuple[str, float] | None,
    noise: float | None,
    report: str | None,
    into: str | None,
    seed: int,
) -> Answer:
    """Diagnose one pump or motor: its losses against the loss terms of the paper.

    UNIT.csv holds kind, displacement, displacement_ratio, speed, pressure, and any of flow (or
    flow_loss, volumetric_efficiency), torque (or torque_loss, mechanical_efficiency), drain_flow,
    electric_power; a flow or a drain flow is needed. In SI, or with the unit behind the name:
    pressure_bar, speed_rpm, displacement_cm3, flow_L/min.

    With --baseline the sound unit is fitted first and held, and only the change is diagnosed.
    """
    common.one_of("choose what is held out", holdout=holdout, above=above)
    common.one_of(
        "a change is not put into a transmission", baseline=baseline, into=into
    )
    common.keep_inputs([table, holdout, baseline], [report, into])
    samples = read_unit(
        table, kind=kind, unit=name, displacement=displacement, noise=noise
    )
    held_out: UnitSamples | None = None
    if holdout is not None:
        held_out = read_unit(
            holdout,
            kind=samples.kind,
            unit=name,
            displacement=displacement,
            noise=noise,
        )
    sound = None
    if baseline is not None:
        sound = read_unit(
            baseline, kind=samples.kind, displacement=displacement, noise=noise
        )
    if above is not None:
        samples, held_out = samples.divided(*above)
    # Loaded first, so that a wrong file is refused before the work.
    model = None if into is None else common.model_from(into)
    with common.Progress("diagnosis") as progress:
        diagnosis = diagnose_unit(
            samples, held_out, seed=seed, progress=progress, baseline=sound
        )
    lines = []
    if into is not None and model is not None:
        assert isinstance(diagnosis, UnitDiagnosis)  # without a baseline
        save_model(put_into(model, diagnosis), into)
        lines.append(f"{samples.kind} written into {into}")
    return diagnosis_answer(diagnosis, report, None, lines)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt diagnose-system`: the gap between any simulator and its bench."""

import click

import hmcvt_core as hmcvt

from . import common
from .common import Answer
from .gap import diagnosis_answer
from .quantities import number


def _noise(
    _: click.Context, __: click.Parameter, values: tuple[str, ...]
) -> dict[str, float]:
    """Read channels and their standard deviations, such as torque=0.4."""
    noise = {}
    for text in values:
        channel, equals, value = text.partition("=")
        if not equals:
            raise click.BadParameter(f"{text!r}: write CHANNEL=STD, such as torque=0.4")
        deviation = number(value)
        if not deviation > 0.0:
            raise click.BadParameter(f"{text!r}: a standard deviation is above 0")
        noise[channel] = deviation
    return noise


@common.command(
    "diagnose-system",
    """
  hmcvt diagnose-system examples/electric_drive.py:system data/electric_drive.csv
  hmcvt diagnose-system examples/electric_drive.py:system data/electric_drive.csv \
    --noise battery_power=15 --noise phase_current=0.15 --report drive.html""",
    common.report_option,
    common.picture_option,
    common.seed_option,
)
@click.argument("system", metavar="MODULE:SYSTEM")
@click.argument("bench", metavar="BENCH.csv")
@click.option(
    "--noise",
    multiple=True,
    metavar="CHANNEL=STD",
    callback=_noise,
    help="Standard deviation of the readings of a channel, in its unit; may be repeated.",
)
@click.option(
    "--holdout",
    metavar="H.csv",
    help="Samples to measure the shrinkage on; cross-validation when left out.",
)
def command(
    system: str,
    bench: str,
    noise: dict[str, float],
    holdout: str | None,
    report: str | None,
    picture: str | None,
    seed: int,
) -> Answer:
    """Diagnose the gap between any simulator and its bench.

    SYSTEM is a `hmcvt.Simulator` or another `hmcvt.System`, or a class or function that makes one,
    in a module or a Python file (file.py:SYSTEM); the file is run. BENCH.csv has a column for each
    axis and channel of the system; CHANNEL_std holds standard deviations of readings.
    """
    common.keep_inputs([bench, holdout], [report, picture])
    machine = hmcvt.load_system(system)
    observed, notes = hmcvt.read_observations(machine, bench, noise=noise)
    held_out = None
    if holdout is not None:
        held_out, _ = hmcvt.read_observations(machine, holdout, noise=noise)
    with common.Progress("diagnosis") as progress:
        diagnosis = hmcvt.diagnose_system(
            machine, observed, held_out, notes=notes, seed=seed, progress=progress
        )
    return diagnosis_answer(diagnosis, report, picture, [])

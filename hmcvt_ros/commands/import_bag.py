# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import-bag`."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import click

from hmcvt_core import InputError, write_bench
from hmcvt_core.transmission.units import kind_of
from hmcvt_tools import UNITS, Shafts
from hmcvt_tools.cli.common import Answer, OutputFile, Progress, answers
from hmcvt_tools.tables.units import to_si, unit_of

from ..bag import BAG_FILES, ImportSettings, Steadiness, import_bag

LIMITS = [
    item for item in (*fields(Steadiness), *fields(ImportSettings)) if item.metadata
]
"""Settings that are limits; each becomes an option."""


def _limits(function: Callable[..., Any]) -> Callable[..., Any]:
    for item in reversed(LIMITS):
        option = click.option(
            f"--{item.name.replace('_', '-')}",
            type=float,
            show_default=True,
            default=item.default,
            help=item.metadata["text"],
        )
        function = option(function)
    return function


def _signal(text: str) -> tuple[str, tuple[str, float]]:
    """Read NAME=TOPIC[:UNIT]: the name of a signal, its topic, and the unit's size in SI."""
    name, _, source = text.partition("=")
    topic, _, unit = source.partition(":")
    if name not in Shafts._fields or not topic:
        raise click.BadParameter(
            f"{text!r}: write NAME=TOPIC[:UNIT], the name one of "
            f"{', '.join(Shafts._fields)}"
        )
    return name, (topic, _size(name, unit, text))


def _size(name: str, unit: str, text: str) -> float:
    """Return the size of the unit of a signal in SI; 1 for no unit.

    Args:
        name: of the signal.
        unit: as the user wrote it.
        text: of the option, for messages.

    Raises:
        click.BadParameter: the unit measures something else, or its zero is not that of SI.
    """
    if not unit:
        return 1.0
    known = unit_of(unit)
    try:
        size, zero = to_si(kind_of(name), unit if known is None else known.name)
    except KeyError:
        raise click.BadParameter(
            f"{text!r}: {unit!r} is no unit of {name}; there is {', '.join(UNITS[name])}"
        ) from None
    if zero:
        raise click.BadParameter(
            f"{text!r}: {unit!r} has another zero than SI, which a topic of a bag cannot have"
        )
    return size


@click.command(
    "import-bag",
    epilog="""\b
Examples:
  hmcvt import-bag run1 --out samples.csv
  hmcvt import-bag run1.mcap --out samples.csv --topic shafts --namespace tractor1
  hmcvt import-bag run1 --out samples.csv --min-duration 8 --torque-scatter 0.03 --json""",
    short_help="turn a recorded bag (rosbag2) into bench samples",
)
@click.argument("bag", metavar="BAG")
@click.option(
    "--out",
    type=OutputFile(),
    required=True,
    metavar="S.csv",
    help="Write the bench samples.",
)
@click.option(
    "--topic",
    default=ImportSettings.topic,
    show_default=True,
    metavar="NAME",
    help="JointState with speed and torque of joints engine and output.",
)
@click.option(
    "--signal",
    "signals",
    type=_signal,
    multiple=True,
    metavar="NAME=TOPIC[:UNIT]",
    help="Where each signal has a topic of numbers (Float64, Int32): once for each of "
    f"{', '.join(Shafts._fields)}; in SI, or engine_speed=/engine/speed:rpm.",
)
@click.option(
    "--namespace",
    default=None,
    metavar="NS",
    help="Namespace of all topics, when the bag holds several.",
)
@_limits
@click.option(
    "--averaged",
    is_flag=True,
    help="Each message is a steady average already: one sample each.",
)
@click.option(
    "--no-oil-temperature", is_flag=True, help="Do not read the topic oil_temperature."
)
@click.option(
    "--no-stage",
    is_flag=True,
    help="Do not read the stage from header.frame_id and the topic stage.",
)
@answers
def command(
    bag: str,
    out: str,
    topic: str,
    signals: Sequence[tuple[str, tuple[str, float]]],
    namespace: str | None,
    age_limit: float,
    gap: float,
    averaged: bool,
    no_oil_temperature: bool,
    no_stage: bool,
    **steady: float,
) -> Answer:
    """Turn a recorded bag (rosbag2: sqlite3, mcap) into bench samples.

    One sample for each window with settled speeds, torques and displacement ratio; transients are
    rejected. BAG is the folder or one of its files. The stage engaged becomes the column `stage`.
    """
    if len(dict(signals)) < len(signals):
        raise click.BadParameter("each signal has one topic", param_hint="--signal")
    settings = ImportSettings(
        topic=topic,
        namespace=namespace,
        steadiness=Steadiness(**steady),
        age_limit=age_limit,
        gap=gap,
        averaged=averaged,
        use_oil_temperature=not no_oil_temperature,
        signals=dict(signals),
        use_stage=not no_stage,
    )
    if Path(out).exists() and Path(out).suffix in BAG_FILES:
        raise InputError(f"{out}: a file of a bag is not written over")
    with Progress("reading") as progress:
        samples, report = import_bag(bag, settings, progress)
    write_bench(out, samples)
    return Answer(
        {**asdict(report), "samples": len(samples), "out": out},
        [report.text(), f"{len(samples)} bench samples written to {out}"],
    )

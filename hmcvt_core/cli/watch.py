# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt watch`."""

from __future__ import annotations

from dataclasses import asdict
from importlib.metadata import entry_points
from pathlib import Path

import click

from ..benches.watch import FALSE_ALARMS, watch
from ..files.bench import BenchSamples, read_bench
from . import common

GROUP = "hmcvt.readers"
"""Entry points that read bench samples from other files: ending (or `folder`) = function(path)."""

OPEN = 4
"""Exit code when a gap has opened."""


@click.command("watch", epilog="""\b
Examples:
  hmcvt watch samples.csv
  hmcvt watch samples.csv --params mine.yaml --noise 0.01 --json""")
@click.argument("samples", metavar="SAMPLES")
@common.params_option
@common.noise_option
@click.option("--false-alarms", type=click.FloatRange(0.0, 0.5, min_open=True), show_default=True,
              default=FALSE_ALARMS, help="Chance of one in a whole stream, however long.")
@common.json_option
@click.pass_context
def command(
    ctx: click.Context, samples: str, params: str | None, noise: float | None,
    false_alarms: float, as_json: bool,
) -> None:
    """Tell whether a gap has opened between model and bench, since when and how large.

    SAMPLES is a bench file, or a bag where hmcvt_ros is installed; its samples are taken one by
    one, by their stamps where they have any. Exit code 4 when a gap has opened, else 0.
    """
    model = common.model_from(params)
    found = watch(model, _read(samples), noise=noise, false_alarms=false_alarms)
    if as_json:
        common.print_json(asdict(found))
    else:
        click.echo(found)
    ctx.exit(OPEN if found.open else 0)


def _read(path: str) -> BenchSamples:
    kind = "folder" if Path(path).is_dir() else Path(path).suffix.removeprefix(".")
    reader = next(iter(entry_points(group=GROUP, name=kind)), None)
    found: BenchSamples = read_bench(path) if reader is None else reader.load()(path)
    return found

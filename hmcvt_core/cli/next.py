# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt next`."""

from __future__ import annotations

import click

from ..benches.transmission import next_test, read_plan
from ..diagnosis import words
from ..files.bench import read_bench
from . import common


@click.command("next", epilog="""\b
Examples:
  hmcvt next bench.csv --noise 0.004
  hmcvt next bench.csv --limits plan.csv --json""")
@click.argument("bench", metavar="BENCH.csv")
@common.params_option
@common.noise_option
@click.option("--limits", metavar="PLAN.csv",
              help="The tests that can be run; the working range when left out.")
@common.json_option
def command(
    bench: str, params: str | None, noise: float | None, limits: str | None, as_json: bool
) -> None:
    """Choose the next bench test, the one that tells most about the gap, or say why to stop."""
    model = common.model_from(params)
    possible = None if limits is None else read_plan(limits, model)
    found = next_test(model, read_bench(bench), noise=noise, possible=possible)
    if as_json:
        common.print_json(found.to_dict())
    else:
        click.echo(words.advice(found))

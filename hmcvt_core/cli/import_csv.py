# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import-csv`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from ..files.bench import UNITS, read_raw_bench, write_bench
from ..transmission.ranges import BENCH_COLUMNS
from . import common

_TEXTS = {
    "displacement_ratio": "Pump stroke.",
    "engine_torque": "With output torque and speed it tells the efficiency.",
    "output_torque": "At the output shaft.",
    "load_torque": "Output power / engine speed.",
    "efficiency_std": "Standard deviation of the efficiency.",
    "stamp": "Time of the test.",
    "pressure": "Over the motor, high minus low side.",
}


def _column_options(function: Callable[..., Any]) -> Callable[..., Any]:
    return common.add_options(function, *(
        click.option(f"--{quantity.replace('_', '-')}", metavar="COLUMN[:UNIT]",
                     help=f"{_TEXTS.get(quantity, '')} [{', '.join(units)}]".strip())
        for quantity, units in UNITS.items()))


@click.command("import-csv", epilog="""\b
Examples:
  hmcvt import-csv raw.csv --out bench.csv --displacement-ratio stroke:% \\
      --engine-speed n_engine:rpm --engine-torque M_engine \\
      --output-speed n_output:rpm --output-torque M_output
  hmcvt import-csv raw.csv --out bench.csv --displacement-ratio eps --engine-speed n:rpm \\
      --load-torque M --efficiency eta:%""")
@click.argument("raw", metavar="RAW.csv")
@click.option("--out", type=common.OutputFile(), required=True, metavar="BENCH.csv",
              help="Write the bench samples.")
@_column_options
@click.option("--header-row", type=click.IntRange(1, 10_000), metavar="LINE",
              help="Line of the header, from 1; lines above it are left out.")
@common.json_option
def command(
    raw: str, out: str, header_row: int | None, as_json: bool, **given: str | None
) -> None:
    """Turn the table of your bench into bench samples.

    Each option names a column of RAW.csv and its unit, the first in brackets when left out. Where
    no column holds efficiency or load torque they are computed from torques and speeds of the
    shafts. Other columns are kept. A row of units below the header is left out.
    """
    common.keep_inputs([raw], [out])
    columns = {quantity: text for quantity, text in given.items() if text is not None}
    samples = read_raw_bench(raw, columns, header_row=header_row)
    write_bench(out, samples)
    found = [(column, values) for column in BENCH_COLUMNS
             if (values := getattr(samples, column.name)) is not None]
    if as_json:
        common.print_json({"samples": len(samples), "out": out, "columns": {
            column.name: {"unit": column.unit, "low": values.min(), "high": values.max()}
            for column, values in found}})
        return
    click.echo(common.table(("column", "unit", "lowest", "highest"), [
        (column.name, column.unit, f"{values.min():.4g}", f"{values.max():.4g}")
        for column, values in found]))
    click.echo(f"{len(samples)} bench samples written to {out}")

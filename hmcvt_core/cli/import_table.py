# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import`, and `hmcvt import-csv`, its older name."""

import shlex

import click

from ..errors import InputError
from ..files.bench import write_bench
from ..files.guess import UNITS
from ..files.raw import choose_columns, import_table
from ..transmission.ranges import BENCH_COLUMNS
from . import common
from .common import Answer

_TEXTS = {
    "displacement_ratio": "Pump stroke.",
    "engine_torque": "With output torque and speed it tells the efficiency.",
    "output_torque": "At the output shaft.",
    "load_torque": "Output power / engine speed.",
    "efficiency_std": "Standard deviation of the efficiency.",
    "stamp": "Time of the test; dates and times of day will do.",
    "pressure": "Over the motor, high minus low side.",
    "stage": "Stage engaged, as text.",
}


_quantities = common.options(
    *(
        click.option(
            f"--{quantity.replace('_', '-')}",
            metavar="COLUMN[:UNIT]",
            help=" ".join(filter(None, (_TEXTS.get(quantity), units))),
        )
        for quantity, units in (
            *((key, f"[{', '.join(value)}]") for key, value in UNITS.items()),
            ("stage", ""),
        )
    )
)


@common.command(
    "import",
    """
  hmcvt import raw.csv --out bench.csv
  hmcvt import raw.csv --out bench.csv --displacement-ratio stroke:% \\
      --engine-speed n_engine:rpm --engine-torque M_engine \\
      --output-speed n_output:rpm --output-torque M_output
  hmcvt import raw.csv --out bench.csv --displacement-ratio eps --engine-speed n:rpm \\
      --load-torque M --efficiency eta:%""",
)
@click.argument("raw", metavar="TABLE")
@click.option(
    "--out",
    type=common.OutputFile(),
    required=True,
    metavar="BENCH.csv",
    help="Write the bench samples.",
)
@_quantities
@click.option(
    "--header-row",
    type=click.IntRange(1, 10_000),
    metavar="LINE",
    help="Line of the header, from 1; found when left out.",
)
@click.option("--sheet", metavar="NAME", help="Of an Excel file.")
@click.option("--yes", is_flag=True, help="Take the guess of what is not named.")
@click.option("--skip-bad", is_flag=True, help="Leave out rows that hold no test.")
@click.option(
    "--averaged",
    is_flag=True,
    help="Each row is a steady test, however fast the stamps rise.",
)
def command(
    raw: str,
    out: str,
    header_row: int | None,
    sheet: str | None,
    yes: bool,
    skip_bad: bool,
    averaged: bool,
    **given: str | None,
) -> Answer:
    """Turn the table of your bench (CSV, Excel) into bench samples.

    Each option names a column of TABLE, or a number for all rows, and the unit, the first in
    brackets when left out. What is not named is guessed: without --yes the guess is shown and
    nothing is written. Efficiency and load torque are computed where no column holds them. Other
    columns are kept. A recording is cut into its steady windows.
    """
    common.keep_inputs([raw], [out])
    columns = {quantity: text for quantity, text in given.items() if text is not None}
    table, chosen = choose_columns(
        raw, columns, header_row=header_row, sheet=sheet, guess=True
    )
    guesses = {quantity: column for quantity, column in chosen.items() if column.why}
    columns |= {
        quantity: f"{column.name}:{column.unit}" if column.unit else column.name
        for quantity, column in guesses.items()
    }
    options = {**columns, "header_row": header_row, "sheet": sheet}
    command = ["hmcvt", "import", raw, "--out", out]
    for name, value in options.items():
        command += [f"--{name.replace('_', '-')}", str(value)] * (value is not None)
    command += ["--averaged"] * averaged + ["--skip-bad"] * skip_bad
    told = [
        common.table(
            ("quantity", "column", "unit", "told by"),
            [
                (quantity, column.name, column.unit or "-", column.why)
                for quantity, column in guesses.items()
            ],
        ),
        "",
        f"the same said: {shlex.join(command)}",
    ]
    try:
        found = import_table(
            table,
            chosen,
            averaged=averaged,
            skip_bad=skip_bad or bool(guesses and not yes),
        )
    except InputError as error:
        if not guesses:
            raise
        click.echo("\n".join(told), err=True)
        raise InputError(
            f"{error}; this was guessed: name the column and unit that are wrong, or "
            "a number that holds in all rows"
        ) from None
    samples = found.samples
    data = {
        "samples": len(samples),
        "out": None,
        "left_out": found.left_out,
        "notes": found.notes,
        "from": columns,
    }
    if guesses and not yes:
        return Answer(
            data,
            [
                *told,
                *(f"without {line}" for line in found.left_out),
                *found.notes,
                f"{len(samples)} bench samples would be written; --yes takes the guess, an option "
                "corrects it"
                + "; --skip-bad leaves the rows above out"
                * bool(found.left_out),
            ],
        )
    write_bench(out, samples)
    kept = {
        column.name: {"unit": column.unit, "low": values.min(), "high": values.max()}
        for column in BENCH_COLUMNS
        if (values := samples.columns.get(column.name)) is not None
    }
    return Answer(
        {**data, "out": out, "columns": kept},
        [
            common.table(
                ("column", "unit", "lowest", "highest"),
                [
                    (name, each["unit"], f"{each['low']:.4g}", f"{each['high']:.4g}")
                    for name, each in kept.items()
                ],
            ),
            *(f"left out: {each}" for each in found.left_out),
            *found.notes,
            f"{len(samples)} bench samples written to {out}",
        ],
    )

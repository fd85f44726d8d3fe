# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import`, and `hmcvt import-csv`, its older name."""

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import BenchSamples, write_bench
from hmcvt_core.transmission.quantities import QUANTITIES
from hmcvt_core.transmission.ranges import BENCH_COLUMNS
from hmcvt_core.transmission.units import UNITS

from ..logs.opening import is_log
from ..tables.header import RawTable
from ..tables.mapping import mapping_text, read_mapping
from ..tables.raw import Column, Imported, Proposal, choose_columns, import_table
from . import common, logs
from .common import Answer
from .import_checks import checked_by_gears, with_session

_STAMP_UNITS = "a number or a date; UNIT may be dmy or mdy"


_HIDDEN = ("torque_loss", "engine_power", "efficiency_std")
"""Quantities whose options are not in --help: a question names them where one is needed."""

skip_bad_option = click.option(
    "--skip-bad", is_flag=True, help="Leave out rows that hold no test."
)


def _quantity_options() -> Callable[[common.Function], common.Function]:
    """Return one option for each quantity, and one for the stage."""
    made = []
    for quantity in QUANTITIES:
        units = ", ".join(UNITS[quantity.name])
        meaning = f"{quantity.meaning[0].upper()}{quantity.meaning[1:]}"
        if quantity.name == "stamp":
            meaning = f"{meaning}, {_STAMP_UNITS}"
        text = f"{meaning}. [{units}]"
        hidden = quantity.name in _HIDDEN
        made.append(logs.quantity_option(quantity.name, text, hidden=hidden))
    made.append(logs.quantity_option("stage", "Stage engaged, as text."))
    return common.options(*made)


@common.command(
    "import",
    """
  hmcvt import raw.csv --out bench.csv
  hmcvt import raw.csv --out bench.csv --displacement-ratio stroke:% \\
      --engine-speed n_engine:rpm --engine-torque M_engine \\
      --output-speed n_output:rpm --output-torque M_output
  hmcvt import raw.csv --out bench.csv --displacement-ratio eps --engine-speed n:rpm \\
      --load-torque M --efficiency eta:%
  hmcvt import test.mf4 --out bench.csv --yes --save-mapping daq.yaml
  hmcvt import bus.blf --dbc bench.dbc --out bench.csv --yes
  hmcvt import test.mf4 --out bench.csv --mapping daq.yaml""",
    logs.options_of_logs,
)
@click.argument("raw", metavar="TABLE")
@click.option(
    "--out",
    type=common.OutputFile(),
    required=True,
    metavar="BENCH.csv",
    help="Write the bench samples.",
)
@_quantity_options()
@click.option(
    "--header-row",
    type=click.IntRange(1, 10_000),
    metavar="LINE",
    help="Line of the header, from 1; searched when left out.",
)
@click.option(
    "--names",
    metavar="NAME,NAME,...",
    help="Names of all columns with their units, for a table without a header, as "
    "'n_engine [rpm],M_engine [Nm],eta [%]'.",
)
@click.option(
    "--matrix",
    metavar="ROWS,COLUMNS,CELLS",
    help="Names of both axes and of the cells of a map that is a matrix, as "
    "'engine speed [rpm],load torque [Nm],efficiency [%]'.",
)
@click.option("--sheet", metavar="NAME", help="Of an Excel file.")
@click.option(
    "--decimal",
    type=click.Choice(["point", "comma"]),
    help="Decimal sign of all columns; the table decides when left out.",
)
@click.option(
    "--mapping",
    metavar="FILE.yaml",
    help="Columns and settings of a file that --save-mapping wrote.",
)
@click.option(
    "--save-mapping",
    type=common.OutputFile(),
    metavar="FILE.yaml",
    help="Write the columns and settings used, for tables of the same kind.",
)
@click.option(
    "--session",
    metavar="COLUMN",
    help="Column that names the session of each test, between which the meters may drift; of "
    "the column of the stamps each day is one.",
)
@click.option(
    "--transmission",
    metavar="T.yaml",
    help="Transmission file: the speeds of each stage are checked against it.",
)
@click.option(
    "--yes", is_flag=True, help="Take the proposal, where nothing in it is open."
)
@skip_bad_option
@click.option(
    "--averaged",
    is_flag=True,
    help="Each row is a steady test, however fast the stamps rise.",
)
@click.option(
    "--unchecked",
    is_flag=True,
    help="Take values that contradict each other or look like another unit.",
)
def command(
    raw: str,
    out: str,
    header_row: int | None,
    names: str | None,
    matrix: str | None,
    sheet: str | None,
    decimal: str | None,
    mapping: str | None,
    save_mapping: str | None,
    session: str | None,
    transmission: str | None,
    yes: bool,
    skip_bad: bool,
    averaged: bool,
    unchecked: bool,
    **given: Any,
) -> Answer:
    """Turn the table or the log of your bench into bench samples.

    TABLE is CSV or Excel, or a log: MDF4, TDMS, or a CAN trace. Each option names a column of
    TABLE, or a number for all rows, and the unit; without a unit that of the header holds, else
    the first in brackets. For what is not named, columns are proposed: without --yes the proposal
    is shown and nothing is written. What the table leaves open is asked. Efficiency and load
    torque are computed where no column holds them. Other columns are kept. A recording is cut into
    its steady windows.
    """
    inputs = [raw, mapping, transmission]
    common.keep_inputs(inputs, [out] if save_mapping is None else [out, save_mapping])
    of_logs = logs.taken_from(given)
    if is_log(raw):
        if session is not None or transmission is not None:
            raise click.UsageError("--session and --transmission are for tables")
        return logs.import_command(
            raw, out, mapping, save_mapping, yes, unchecked, given, of_logs
        )
    logs.refuse_options_of_logs(of_logs)
    settings: dict[str, Any] = {
        "header_row": header_row,
        "sheet": sheet,
        "decimal": decimal,
        "names": names,
        "matrix": matrix,
    }
    named = _named_columns(mapping, given, settings)
    table, proposal = choose_columns(
        raw, named, guess=True, averaged=averaged, **settings
    )
    guesses = {name: column for name, column in proposal.columns.items() if column.why}
    columns = named | {name: _text(column) for name, column in guesses.items()}
    named_files = {"session": session, "transmission": transmission}
    flags = {"averaged": averaged, "skip-bad": skip_bad, "unchecked": unchecked}
    explained = _explanation(table, guesses, proposal)
    explained.append(
        f"the same as a command: {_command(raw, out, columns, {**settings, **named_files}, flags)}"
    )
    _refuse_open(table, proposal, explained)
    only_shown = bool(guesses) and not yes
    try:
        imported = import_table(
            table,
            proposal,
            averaged=averaged,
            skip_bad=skip_bad or only_shown,
            unchecked=unchecked,
            session=session,
        )
    except InputError as error:
        if not guesses:
            raise
        click.echo("\n".join(explained), err=True)
        raise InputError(
            f"{error}; columns were proposed: name the column and unit that are wrong, or "
            "a number that holds in all rows"
        ) from None
    if session is not None:
        imported = with_session(imported, proposal, session)
    if transmission is not None:
        imported = checked_by_gears(imported, transmission)
    data = _data(table, imported, columns)
    if only_shown:
        return Answer(data, [*explained, *_preview(imported)])
    write_bench(out, imported.samples)
    if save_mapping is not None:
        write_atomically(Path(save_mapping), mapping_text(columns, settings))
    kept = _summary(imported.samples)
    return Answer(
        {**data, "out": out, "columns": kept}, _written(table, imported, kept, out)
    )


def _named_columns(
    mapping: str | None,
    given: Mapping[str, str | None],
    settings: dict[str, Any],
) -> dict[str, str]:
    """Return the columns of a mapping file and of the options, which go before it.

    Args:
        mapping: file, or None.
        given: value of every option that names a column.
        settings: of the options; what is None is taken from the file.
    """
    named: dict[str, str] = {}
    if mapping is not None:
        named, saved = read_mapping(mapping)
        for name, value in saved.items():
            if name not in settings:
                raise InputError(f"{mapping}: {name} is for logs, not for a table")
            if settings[name] is None:
                settings[name] = value
    for quantity, text in given.items():
        if text is not None:
            named[quantity] = text
    return named


def _data(
    table: RawTable, imported: Imported, columns: Mapping[str, str]
) -> dict[str, Any]:
    """Return the JSON of an import that writes nothing."""
    return {
        "samples": len(imported.samples),
        "out": None,
        "left_out": imported.left_out,
        "notes": imported.notes,
        "from": columns,
        "header_row": table.header_row,
        "sheet": table.sheet or None,
        "rows": len(table.rows) + len(table.broken),
    }


def _written(
    table: RawTable,
    imported: Imported,
    kept: Mapping[str, Mapping[str, Any]],
    out: str,
) -> list[str]:
    """Return the lines of an import that writes `out`."""
    lines = [_source_line(table), _range_table(kept)]
    for line in imported.left_out:
        lines.append(f"left out: {line}")
    lines += imported.notes
    lines.append(f"{len(imported.samples)} bench samples written to {out}")
    return lines


def _range_table(kept: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the lowest and highest value of every column as a table."""
    rows = []
    for name, row in kept.items():
        rows.append((name, row["unit"], f"{row['low']:.4g}", f"{row['high']:.4g}"))
    return common.table(("column", "unit", "lowest", "highest"), rows)


def _text(column: Column) -> str:
    """Return a column as its option takes it."""
    if not column.unit:
        return column.name
    return f"{column.name}:{column.unit}"


def _command(
    raw: str,
    out: str,
    columns: Mapping[str, str],
    settings: Mapping[str, Any],
    flags: Mapping[str, bool],
) -> str:
    """Return the command that names every column."""
    words = ["hmcvt", "import", raw, "--out", out]
    for name, value in {**columns, **settings}.items():
        if value is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    for name, given in flags.items():
        if given:
            words.append(f"--{name}")
    return shlex.join(words)


def _source_line(table: RawTable) -> str:
    """Say which file, sheet, header and rows were read."""
    sheet = ""
    if table.sheet:
        sheet = f", sheet {table.sheet!r}"
    units = ""
    if table.units:
        units = " and a row of units"
    header = f"header in row {table.header_row}{units}"
    if table.matrix:
        return f"{table.source}{sheet}: {table.matrix}"
    if table.header_row == 0:
        header = "names of the columns as given"
    return (
        f"{table.source}{sheet}: {header}, {len(table.rows) + len(table.broken)} rows "
        "below it"
    )


def _explanation(
    table: RawTable, guesses: Mapping[str, Column], proposal: Proposal
) -> list[str]:
    """Return the proposal with the reason of every column."""
    rows = []
    for quantity, column in guesses.items():
        rows.append((quantity, column.name, column.unit or "-", column.why))
    lines = [
        _source_line(table),
        common.table(("quantity", "column", "unit", "reason"), rows),
    ]
    for quantity, column in proposal.spares.items():
        lines.append(f"compared with it: {quantity} in column {column.name!r}")
    return [*lines, ""]


def _refuse_open(table: RawTable, proposal: Proposal, explained: list[str]) -> None:
    """Raise an `InputError` with what the table leaves open."""
    if not proposal.questions:
        return
    click.echo("\n".join(explained), err=True)
    questions = "; ".join(str(question) for question in proposal.questions)
    missing = proposal.missing_anyway()
    if missing:
        questions += (
            f"; besides, no column is named for {', '.join(missing)} (an option may give a "
            "number for all rows)"
        )
    raise InputError(f"{table.source}: {questions}")


def _preview(imported: Imported) -> list[str]:
    """Return what an import would leave out, note and write."""
    lines = [_range_table(_summary(imported.samples))]
    for line in imported.left_out:
        lines.append(f"without {line}")
    lines += imported.notes
    skip = ""
    if imported.doubtful:
        skip = "; --skip-bad leaves the rows above out"
    lines.append(
        f"{len(imported.samples)} bench samples would be written; --yes takes the "
        f"proposal, an option corrects it{skip}"
    )
    return lines


def _summary(samples: BenchSamples) -> dict[str, dict[str, Any]]:
    """Return unit, lowest and highest value of every column."""
    kept = {}
    for column in BENCH_COLUMNS:
        values = samples.columns.get(column.name)
        if values is not None:
            kept[column.name] = {
                "unit": column.unit,
                "low": values.min(),
                "high": values.max(),
            }
    return kept

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the commands on logs share: their options, the mapping file, and `hmcvt import` of a log."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from hmcvt_core.errors import InputError
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.files.bench import write_bench
from hmcvt_core.model.engine import load_engine
from hmcvt_core.model.model import EfficiencyModel
from hmcvt_core.monitoring import watch

from ..estimation.bus_watch import watch_bus
from ..logs.log_import import import_log, what_is_missing
from ..logs.opening import open_log
from ..logs.selection import Selection, Stated, concerning, select
from ..logs.series import Log
from ..tables.mapping import mapping_text, read_mapping
from . import common
from .common import Answer

OPEN = 4
"""Exit code when a watch sees a gap or a drift."""

SETTINGS = ("dbc", "reference_torque", "friction_torque", "stage_names", "group")
"""Settings of a log that a mapping file holds besides its columns."""

options_of_logs = common.options(
    click.option(
        "--dbc",
        metavar="FILE.dbc",
        help="Signals of a maker's CAN messages; those of J1939 are known.",
    ),
    click.option(
        "--reference-torque",
        type=common.torque,
        metavar="TORQUE",
        help="Engine torque of 100 %, where the bus does not state it: 800Nm.",
    ),
    click.option(
        "--friction-torque",
        type=common.fraction,
        metavar="PART",
        help="Friction of the engine as a part of it, where the bus does not state it: 8%.",
    ),
    click.option(
        "--stage-names",
        metavar="CODE=NAME,...",
        help="Stages by what stands in their channel: 1=HM1,2=HM2.",
    ),
    click.option(
        "--group",
        metavar="NAME",
        help="Group, run or bus of a log that is read, where several hold the same channels.",
    ),
)


def quantity_option(quantity: str, text: str, *, hidden: bool = False) -> common.Option:
    """Return the option that names the column or channel of a quantity.

    Args:
        quantity: its name.
        text: of --help.
        hidden: from --help, for a quantity that few tables hold.
    """
    return click.option(
        common.flag(quantity), metavar="NAME[:UNIT]", help=text, hidden=hidden
    )


def taken_from(options: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the options of logs, and remove them from all options."""
    return {name: options.pop(name) for name in SETTINGS}


def stage_names_of(text: str | None) -> dict[str, str]:
    """Read CODE=NAME,CODE=NAME.

    Raises:
        click.BadParameter: an entry has another form.
    """
    names = {}
    for entry in (text or "").split(","):
        if not entry.strip():
            continue
        code, equals, name = entry.partition("=")
        if not equals or not code.strip() or not name.strip():
            raise click.BadParameter(f"{entry!r}: write CODE=NAME, such as 1=HM1")
        names[code.strip()] = name.strip()
    return names


def stated_by(
    mapping: str | None, columns: Mapping[str, str | None], given: Mapping[str, Any]
) -> tuple[Stated, str | None, dict[str, Any]]:
    """Return what options and a mapping file state of a log; options go first.

    Args:
        mapping: file, or None.
        columns: `CHANNEL:UNIT` by quantity, None where it is not given.
        given: values of the options `SETTINGS`.

    Returns:
        What is stated, the DBC, and the settings as a mapping file holds them.
    """
    named: dict[str, str] = {}
    settings = dict.fromkeys(SETTINGS)
    if mapping is not None:
        named, saved = read_mapping(mapping)
        for name in SETTINGS:
            settings[name] = saved.get(name)
    for quantity, text in columns.items():
        if text is not None:
            named[quantity] = text
    for name in SETTINGS:
        if given[name] is not None:
            settings[name] = given[name]
    friction: Any = settings["friction_torque"]
    stated = Stated(
        named,
        None
        if settings["reference_torque"] is None
        else float(settings["reference_torque"]),
        None if friction is None else 100.0 * float(friction),
        stage_names_of(settings["stage_names"]),
        settings["group"] or "",
    )
    return stated, settings["dbc"], settings


def chosen_columns(selection: Selection) -> dict[str, str]:
    """Return the channels of a selection as options and mapping files state them."""
    columns = {}
    for quantity, column in selection.columns.items():
        text = column.name
        if column.unit:
            text += f":{column.unit}"
        columns[quantity] = text
    return columns


def selection_lines(log: Log, selection: Selection) -> list[str]:
    """Return which channels are taken, with the reason, as text."""
    rows = []
    for quantity, column in selection.columns.items():
        why = column.why or "named"
        rows.append((quantity, column.name, column.unit or "-", why))
    torque = selection.torque
    lines = [f"{log.path}: {len(log.channels)} channels"]
    if torque is not None:
        friction = "that of the bus"
        if torque.friction is not None:
            friction = f"{torque.friction:g} %"
        rows.append(("engine_torque", " - ".join(torque.names), "%", "standard"))
        lines.append(
            f"engine torque: 100 % are {torque.reference:g} N m, less friction: {friction}"
        )
    lines.append(common.table(("quantity", "channel", "unit", "reason"), rows))
    return lines


def import_command(
    raw: str,
    out: str,
    mapping: str | None,
    save_mapping: str | None,
    yes: bool,
    unchecked: bool,
    columns: Mapping[str, str | None],
    given: Mapping[str, Any],
) -> Answer:
    """Import a log: show the choice of channels, or write bench samples."""
    stated, dbc, settings = stated_by(mapping, columns, given)
    with open_log(raw, dbc) as log:
        selection = select(log, stated)
        explained = selection_lines(log, selection)
        names = chosen_columns(selection)
        explained.append(
            f"the same as a command: {_command(raw, out, names, settings, unchecked)}"
        )
        refuse_open(log, selection, explained)
        with common.Progress("reading") as progress:
            imported = import_log(
                log, selection, unchecked=unchecked, progress=progress
            )
    proposed = [c for c in selection.columns.values() if c.why not in ("", "standard")]
    only_shown = bool(proposed) and not yes
    data = {
        "samples": len(imported.samples),
        "out": None,
        "left_out": imported.left_out,
        "notes": imported.notes,
        "from": names,
    }
    if only_shown:
        ending = (
            f"{len(imported.samples)} bench samples would be written; --yes takes the "
            "proposal, an option corrects it"
        )
        return Answer(data, [*explained, *imported.notes, ending])
    write_bench(out, imported.samples)
    if save_mapping is not None:
        stated_settings = {name: settings[name] for name in SETTINGS}
        write_atomically(Path(save_mapping), mapping_text(names, stated_settings))
    lines = [*explained[:-1], *imported.notes]
    lines.append(f"{len(imported.samples)} bench samples written to {out}")
    return Answer({**data, "out": out}, lines)


def refuse_open(log: Log, selection: Selection, explained: list[str]) -> None:
    """Raise an `InputError` where a question concerns a channel that is used, or one missing."""
    questions = list(selection.proposal.questions)
    asked = concerning(selection)
    if questions and what_is_missing(selection):
        asked = questions
    if asked:
        click.echo("\n".join(explained), err=True)
        raise InputError(f"{log.path}: {'; '.join(map(str, asked))}")


def _command(
    raw: str,
    out: str,
    columns: Mapping[str, str],
    settings: Mapping[str, Any],
    unchecked: bool,
) -> str:
    words = ["hmcvt", "import", raw, "--out", out]
    for name, value in {**columns, **settings}.items():
        if value is not None:
            words += [common.flag(name), str(value)]
    if unchecked:
        words.append("--unchecked")
    return shlex.join(words)


def watch_command(
    path: str,
    model: EfficiencyModel,
    engine: str | None,
    noise: float | None,
    false_alarms: float,
    given: Mapping[str, Any],
) -> Answer:
    """Watch a log: its steady windows as bench samples, or the bus against itself.

    Args:
        path: of the log.
        model: in service.
        engine: fuel map, or None.
        noise: of the efficiency [-], where the log holds both shafts.
        false_alarms: chance over a whole stream.
        given: values of the options `SETTINGS`.
    """
    stated, dbc, _ = stated_by(None, {}, given)
    with open_log(path, dbc) as log:
        selection = select(log, stated)
        if not what_is_missing(selection):
            samples = import_log(log, selection).samples
            opening = watch(model, samples, noise=noise, false_alarms=false_alarms)
            return Answer(
                opening.to_dict(), [opening.report()], OPEN if opening.open else 0
            )
        fuel_map = None if engine is None else load_engine(engine)
        drift = watch_bus(log, selection, model, fuel_map, false_alarms=false_alarms)
    return Answer(drift.to_dict(), [drift.report()], OPEN if drift.open else 0)


def refuse_options_of_logs(given: Mapping[str, Any]) -> None:
    """Raise a usage error where a table is given options of logs."""
    for name in SETTINGS:
        if given[name] is not None:
            raise click.UsageError(f"{common.flag(name)} is for logs, not for a table")

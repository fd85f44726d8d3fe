# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""All commands of `hmcvt` by name, and how one is run.

A command has a line in `COMMANDS` and returns its answer (`common.answers`). Other packages add
commands through the entry-point group `hmcvt.commands`: name = module:click_command.

Exit codes: 0 done, 2 the input was wrong (one line on stderr), 1 internal failure, 130 interrupted;
3 when a fleet is done but some of its logs are broken, 4 when `watch` sees a gap.
"""

import os
import sys
from importlib.metadata import EntryPoint, entry_points
from typing import NoReturn

import click

from hmcvt_core.errors import HmcvtError
from hmcvt_core.version import __version__

COMMANDS = {
    "identify": (
        "identify:command",
        "identify the hydraulic parameters from bench samples",
    ),
    "study": (
        "study:command",
        "go from a bench and the gears to model, cause, next test and code",
    ),
    "predict": (
        "point:predict",
        "predict the efficiency at a point or at every sample of a file",
    ),
    "optimum": ("point:optimum", "find the displacement ratio that loses least"),
    "map": (
        "map:command",
        "write the efficiency over displacement ratio, engine speed and load",
    ),
    "mission": (
        "mission:command",
        "find the fuel of a work cycle, and how close to the best a strategy comes",
    ),
    "breakdown": ("point:breakdown", "show where the watts go"),
    "diagnose": ("gap:diagnose", "diagnose the gap between model and bench"),
    "next": ("gap:next_test", "choose the bench test that reveals most about a gap"),
    "watch": ("gap:watch", "report whether a gap has opened, since when and how large"),
    "estimate": (
        "estimate:command",
        "estimate output power and losses from the log of a machine",
    ),
    "fleet": ("fleet:command", "identify and diagnose every bench log of a folder"),
    "unit": (
        "gap:unit",
        "diagnose a single pump or motor, from its tests or a maker's table",
    ),
    "diagnose-system": (
        "own_system:command",
        "diagnose the gap between any simulator and its bench",
    ),
    "separable": ("gap:separable", "report which effects a test plan can distinguish"),
    "import": (
        "import_table:command",
        "turn a table (CSV, Excel) or a log (MDF4, TDMS, CAN) into bench samples",
    ),
    "import-csv": ("import_table:command", "the older name of import"),
    "export": (
        "export:command",
        "write the model as C, as an FMU or as maps for MATLAB",
    ),
    "page": (
        "page:command",
        "write a page with sliders, map, optimum and losses",
    ),
    "transmission": (
        "transmission:group",
        "write a transmission file from gear ratios, and check one",
    ),
}
"""Module and name of each command, and what it does."""

SECTIONS = {
    "Model": (
        "identify",
        "predict",
        "optimum",
        "map",
        "breakdown",
        "page",
        "transmission",
    ),
    "Gap between model and bench": (
        "study",
        "diagnose",
        "next",
        "separable",
        "watch",
        "unit",
        "diagnose-system",
        "fleet",
    ),
    "Data in and out": ("import", "import-bag", "export"),
    "Machine": ("mission", "estimate", "node"),
}
"""Sections of the help; a command of another package that is in none comes last."""
HIDDEN = ("import-csv",)
"""Commands that work and are not listed."""

GROUP = "hmcvt.commands"


def _installed() -> dict[str, EntryPoint]:
    """Return commands of other packages by name; names in `COMMANDS` cannot be taken."""
    installed = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        if entry.name not in COMMANDS:
            installed[entry.name] = entry
    return installed


def _load(entry: EntryPoint) -> click.Command:
    """Load a command of another package, or return one that says why it cannot be loaded."""
    try:
        command = entry.load()
    except Exception as error:  # a module of another package may raise anything
        return _unusable(entry, f"cannot be loaded: {type(error).__name__}: {error}")
    if isinstance(command, click.Command):
        return command
    return _unusable(entry, "is no click command")


def _unusable(entry: EntryPoint, reason: str) -> click.Command:
    def refuse() -> NoReturn:
        raise HmcvtError(f"command {entry.name} ({entry.value}) {reason}")

    return click.Command(
        entry.name,
        callback=refuse,
        short_help=f"(cannot be loaded: {entry.value})",
        hidden=True,
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )


class _Commands(click.Group):
    """Loads a command only when it is run, so that --help stays fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*COMMANDS, *_installed()]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in COMMANDS:
            target = f"{__package__}.{COMMANDS[cmd_name][0]}"
            command: click.Command = EntryPoint(cmd_name, target, GROUP).load()
            return command
        entry = _installed().get(cmd_name)
        if entry is None:
            return None
        return _load(entry)

    def format_commands(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        summaries = {name: summary for name, (_, summary) in COMMANDS.items()}
        for name, entry in _installed().items():
            summaries[name] = _load(entry).get_short_help_str(formatter.width)
        listed = {name for names in SECTIONS.values() for name in names}
        others = tuple(sorted(summaries.keys() - listed - set(HIDDEN)))
        for title, names in {**SECTIONS, "Other packages": others}.items():
            lines = [(name, summaries[name]) for name in names if name in summaries]
            if lines:
                with formatter.section(title):
                    formatter.write_dl(lines)


@click.group(
    cls=_Commands,
    invoke_without_command=True,
    epilog="""\b
Examples:
  hmcvt identify data/table2.csv --fit 1,2,4-6
  hmcvt predict --displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt optimum --engine-speed 1400rpm --load-torque 200""",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, prog_name="hmcvt")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Efficiency of hydromechanical CVTs: predict, identify, optimise, diagnose.

    Units: rad/s (or write 1400rpm), N m, plain fractions.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help(), err=True)
        ctx.exit(2)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    run_command(cli, "hmcvt", arguments)


def run_command(
    command: click.Command, name: str, arguments: list[str] | None = None
) -> NoReturn:
    """Run one command, with errors as one line and the exit codes above."""
    try:
        code = command.main(arguments, prog_name=name, standalone_mode=False)
    except (click.exceptions.Abort, KeyboardInterrupt):
        _fail("interrupted", 130)
    except click.UsageError as error:
        message = error.format_message().rstrip(".")
        if error.ctx:
            message += f"; see {error.ctx.command_path} --help"
        _fail(message, 2)
    except (click.ClickException, HmcvtError) as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        # The reader (such as head) has closed the pipe: discard what is still buffered.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        _fail(f"{error.filename or 'output'}: {error.strerror or error}", 2)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, code: int) -> NoReturn:
    line = " ".join(message.split())
    click.echo(f"hmcvt: error: {line}", err=True)
    sys.exit(code)

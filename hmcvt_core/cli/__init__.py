# SPDX-License-Identifier: Apache-2.0
"""The command line: thin commands over the core, one module each.

A command is a module here with a `command` in it and a line in `COMMANDS`.

Exit codes: 0 done, 2 the input was wrong (one line on stderr), 1 internal failure, 130 interrupted;
3 when a fleet is done but some of its logs are broken.
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import NoReturn

import click

from ..errors import HmcvtError
from ..version import __version__

COMMANDS = {
    "identify": "identify the hydraulic parameters from bench samples",
    "predict": "predict the efficiency at a point or at every sample of a file",
    "optimum": "find the displacement ratio that wastes least",
    "map": "write the efficiency over displacement ratio, engine speed and load",
    "breakdown": "show where the watts go",
    "diagnose": "diagnose the gap between model and bench",
    "fleet": "identify and diagnose every bench log of a folder",
    "separable": "tell which effects a test plan can tell apart",
    "blind": "run the blind trial of the diagnosis",
    "reproduce": "put every number and figure of the paper beside ours",
    "import-csv": "turn the table of your bench into bench samples",
    "import-bag": "turn a recorded bag (rosbag2) into bench samples",
    "node": "start the ROS 2 node",
}


class _Commands(click.Group):
    """Loads a command's module only when it is asked for, so that --help stays fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"{__name__}.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=_Commands, invoke_without_command=True, epilog="""\b
Examples:
  hmcvt identify data/table2.csv --fit 1,2,4-6
  hmcvt predict --displacement-ratio 0.5 --engine-speed 1400rpm --load-torque 200
  hmcvt optimum --engine-speed 1400rpm --load-torque 200""",
             context_settings={"help_option_names": ["-h", "--help"]})
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
    try:
        code = cli.main(arguments, prog_name="hmcvt", standalone_mode=False)
    except (click.exceptions.Abort, KeyboardInterrupt):
        _fail("interrupted", 130)
    except click.UsageError as error:
        see = f"; see {error.ctx.command_path} --help" if error.ctx else ""
        _fail(error.format_message().rstrip(".") + see, 2)
    except click.ClickException as error:
        _fail(error.format_message(), 2)
    except HmcvtError as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        # The reader (head, say) has seen enough; what is still buffered has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        _fail(f"{error.filename or 'output'}: {error.strerror or error}", 2)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, code: int) -> NoReturn:
    line = " ".join(message.split())
    click.echo(f"hmcvt: error: {line}", err=True)
    sys.exit(code)

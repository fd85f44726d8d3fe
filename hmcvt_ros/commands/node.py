# SPDX-License-Identifier: Apache-2.0
"""`hmcvt node`."""

from __future__ import annotations

from importlib.metadata import entry_points

import click

from hmcvt_core.errors import InputError

_SCRIPT = "hmcvt-node"


class _Verbatim(click.Command):
    """Hands on what it is given: `--ros-args ... --` has rules of its own."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args[:1] in (["-h"], ["--help"]):
            return super().parse_args(ctx, args)
        ctx.params["arguments"] = tuple(args[1:] if args[:1] == ["--"] else args)
        return []


@click.command("node", cls=_Verbatim, options_metavar="", epilog="""\b
Examples:
  hmcvt node
  hmcvt node --ros-args -p input_timeout:=1.0 -r __ns:=/tractor1
  hmcvt node --ros-args --params-file my.yaml
  hmcvt node -- --help""", short_help="start the ROS 2 node")
@click.argument("arguments", nargs=-1, metavar="[ROS ARGUMENTS...]")
@click.pass_context
def command(ctx: click.Context, arguments: tuple[str, ...]) -> None:
    """Start the ROS 2 node, like the command hmcvt-node; `-- --help` lists its parameters."""
    # Found by the name it is installed under: the core knows nothing of ROS.
    found = tuple(entry_points(group="console_scripts", name=_SCRIPT))
    if not found:
        raise InputError(f"{_SCRIPT} is not installed here; in the folder of hmcvt: "
                         "pip install '.[ros]'")
    try:
        main = found[0].load()
    except ImportError as error:
        raise InputError(f"the node needs ROS 2 ({error}): source its setup.bash, or, in the "
                         "folder of hmcvt, pip install '.[ros]'") from error
    ctx.exit(main([_SCRIPT, *arguments]))

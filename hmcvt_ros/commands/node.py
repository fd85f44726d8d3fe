# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt node`."""

import click

from ..efficiency_node import main


class _Verbatim(click.Command):
    """Hands on what it is given: `--ros-args ... --` has rules of its own."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args[:1] in (["-h"], ["--help"]):
            return super().parse_args(ctx, args)
        ctx.params["arguments"] = tuple(args[1:] if args[:1] == ["--"] else args)
        return []


@click.command(
    "node",
    cls=_Verbatim,
    options_metavar="",
    epilog="""\b
Examples:
  hmcvt node
  hmcvt node --ros-args -p input_timeout:=1.0 -r __ns:=/tractor1
  hmcvt node --ros-args --params-file my.yaml
  hmcvt node -- --help""",
    short_help="start the ROS 2 node",
)
@click.argument("arguments", nargs=-1, metavar="[ROS ARGUMENTS...]")
@click.pass_context
def command(ctx: click.Context, arguments: tuple[str, ...]) -> None:
    """Start the ROS 2 node, like the command hmcvt-node; `-- --help` lists its parameters."""
    ctx.exit(main(["hmcvt-node", *arguments]))

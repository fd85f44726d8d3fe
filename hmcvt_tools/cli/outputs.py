# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Files that a command writes after its answer is printed, so that no failure loses the answer."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import click

from hmcvt_core.errors import HmcvtError

INTERNAL_FAILURE = 1
WRONG_INPUT = 2
"""Exit codes, as docs/cli.md lists them."""


class Output(NamedTuple):
    """A file to write.

    Attributes:
        what: it holds, such as `report`.
        path: of the file.
        write: writes it, whole or not at all.
    """

    what: str
    path: str
    write: Callable[[], None]


def write_outputs(outputs: Iterable[Output], quiet: bool) -> int:
    """Write files one after the other, and say which could not be written and why.

    Args:
        outputs: files to write; one that fails does not hold up the next.
        quiet: print no line for a file that was written.

    Returns:
        Exit code: 0, 2 for a file that cannot be written, 1 for a failure of this program.
    """
    codes = [0]
    for output in outputs:
        try:
            output.write()
        except HmcvtError as error:
            _complain(output, str(error))
            codes.append(WRONG_INPUT)
        except OSError as error:
            _complain(output, error.strerror or str(error))
            codes.append(WRONG_INPUT)
        except Exception as error:
            # The answer above stays valid whatever fails in a drawing.
            _complain(output, f"internal failure, please report it: {error!r}")
            codes.append(INTERNAL_FAILURE)
        else:
            if not quiet:
                click.echo(f"{output.what} written to {output.path}")
    if INTERNAL_FAILURE in codes:
        return INTERNAL_FAILURE
    return max(codes)


def _complain(output: Output, reason: str) -> None:
    line = " ".join(reason.split())
    click.echo(
        f"hmcvt: error: {output.path}: the {output.what} is not written: {line}",
        err=True,
    )

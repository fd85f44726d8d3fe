# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Progress of long work as one line on stderr."""

import math
import sys
import time
from contextlib import AbstractContextManager

import click

QUIET_SECONDS = 2.0
"""Work that takes less than this shows no progress [s]."""

_CLEAR_LINE = "\r\033[K"


class Progress(AbstractContextManager["Progress"]):
    """A line on stderr for work that takes more than two seconds.

    A terminal shows one line that changes. Elsewhere nothing is printed, unless `every` is given.

    Args:
        what: the work, as the line names it.
        every: seconds between two lines where stderr is no terminal [s].
    """

    def __init__(self, what: str, every: float = math.inf) -> None:
        self.what = what
        self.every = every
        self.shown = False
        self.start = time.monotonic()
        self.last_line = self.start

    def seconds(self) -> float:
        """Return how long the work has taken so far [s]."""
        return time.monotonic() - self.start

    def __call__(self, text: str) -> None:
        """Show how far the work is."""
        if sys.stderr.isatty():
            if self.seconds() > QUIET_SECONDS:
                click.echo(f"{_CLEAR_LINE}{self.what}: {text}", err=True, nl=False)
                self.shown = True
            return
        if time.monotonic() - self.last_line > self.every:
            self.last_line = time.monotonic()
            click.echo(f"{self.what}: {text}", err=True)

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Clear the line."""
        if self.shown:
            click.echo(_CLEAR_LINE, err=True, nl=False)

# SPDX-License-Identifier: Apache-2.0
"""A worker process: studies what it is sent until nobody sends any more."""

from __future__ import annotations

import contextlib
from multiprocessing.connection import Connection

from .study import study


def serve(descriptor: int) -> None:
    """Answer tasks on a connection until its other end is closed."""
    # The other end is gone when the run was interrupted or killed: nobody is left to tell.
    with Connection(descriptor) as connection, contextlib.suppress(EOFError, OSError):
        while True:
            task, settings = connection.recv()
            connection.send(study(task.samples, settings))

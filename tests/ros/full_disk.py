# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Disks that are full and folders that cannot be written."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def file_limit(size: int, *processes: int) -> Iterator[None]:
    """Let processes write no file beyond a size [bytes], as if the disk were full.

    Without processes this one. Python ignores the signal that goes with it, so that writes fail.
    """
    assert processes or signal.getsignal(signal.SIGXFSZ) is signal.SIG_IGN
    before = {process: resource.prlimit(process, resource.RLIMIT_FSIZE)
              for process in processes or (0,)}
    for process, (_, hard) in before.items():
        resource.prlimit(process, resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        for process, limits in before.items():
            resource.prlimit(process, resource.RLIMIT_FSIZE, limits)


@contextmanager
def read_only(*paths: Path) -> Iterator[None]:
    """Take away the right to write files and folders."""
    modes = {path: path.stat().st_mode for path in paths}
    for path, mode in modes.items():
        path.chmod(mode & ~0o222)
    try:
        yield
    finally:
        for path, mode in modes.items():
            path.chmod(mode)

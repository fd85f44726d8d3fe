# SPDX-License-Identifier: Apache-2.0
"""How many threads the linear algebra of a worker process may use."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType

ONE_BLAS_THREAD: Mapping[str, str] = MappingProxyType(dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
"""Environment of a process whose threads would fight with those of its neighbours."""


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Give processes that are started meanwhile one thread each; this one has set up its own."""
    before = {name: os.environ.get(name) for name in ONE_BLAS_THREAD}
    os.environ.update(ONE_BLAS_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

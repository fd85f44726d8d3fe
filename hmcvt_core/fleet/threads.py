# SPDX-License-Identifier: Apache-2.0
"""How many threads the linear algebra of a worker process may use."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

ONE_BLAS_THREAD: Mapping[str, str] = MappingProxyType(dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
"""Environment of a process whose threads would fight with those of its neighbours."""

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A fleet: identify and diagnose every bench log of a folder, many at a time.

executors   many logs side by side, on this machine or on a Dask cluster
run         from a folder of logs to their results and the table over them, with robust z scores
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

ONE_BLAS_THREAD: Mapping[str, str] = MappingProxyType(dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
"""Environment of a process whose threads would fight with those of its neighbours."""

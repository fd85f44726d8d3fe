# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A fleet: identify and diagnose every bench log of a folder, many at a time.

executors   any work on many logs side by side, on this machine or on a Dask cluster
run         from a folder of logs to their results; one run at a time in a folder
summary     the table over the fleet, with robust z scores
"""

from collections.abc import Mapping
from types import MappingProxyType

ONE_BLAS_THREAD: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)
"""Environment of a process whose threads would fight with those of its neighbours."""

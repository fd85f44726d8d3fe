# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Many logs side by side: bench logs identified and diagnosed (`run`), others estimated (`road`).

executors   any work on many logs side by side, on this machine or on a Dask cluster
run         from a folder of bench logs to their results; one run at a time in a folder
road        `estimate` over the logs of machines
summary     the table over the fleet, with robust z scores
"""

from collections.abc import Mapping
from types import MappingProxyType

ONE_BLAS_THREAD: Mapping[str, str] = MappingProxyType(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)
"""Environment of a process whose threads would fight with those of its neighbours."""

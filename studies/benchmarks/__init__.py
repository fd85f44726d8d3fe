# SPDX-License-Identifier: Apache-2.0
"""The benchmarks: `make bench`, which writes docs/benchmarks.md.

Every figure is a ratio of two things timed in turns on one machine: each turn gives one ratio, and
the document tells the median and the quartiles over the turns. `bench_*.py` measure, with
pytest-benchmark as the clock and its JSON as the record; `record.py` reads that, and `report.py`
writes the document.
"""

import os

# Before NumPy is loaded. Threads of BLAS that wait for each other spin: SciPy's vectorised
# differential evolution takes twice the processor time with two of them and no less time, and
# several times the time on a machine that has something else to do.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# SPDX-License-Identifier: Apache-2.0
"""`python -m studies.benchmarks`: run every benchmark and write the document."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import pytest

from studies.soak.run import Run, busy_cores

from . import report
from .record import Record

HERE = Path(__file__).parent


def main() -> int:
    """Run them; 0 when they all ran, whether or not a goal is met."""
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/benchmarks.md"))
    parser.add_argument("--record", type=Path, help="keep what pytest-benchmark writes here")
    parser.add_argument("--quick", action="store_true",
                        help="two turns of everything, to try the benchmarks themselves")
    given = parser.parse_args()
    # As Ctrl-C does: the processes that were started end, too.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if given.quick:
        os.environ["HMCVT_BENCH_QUICK"] = "1"
    others = busy_cores()
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hmcvt-bench-") as name:
        file = given.record or Path(name) / "record.json"
        code = pytest.main([
            str(HERE), "-q", "--no-header", "-p", "no:cacheprovider", "--timeout=300",
            "-o", "python_files=bench_*.py", "-o", "python_functions=bench_*",
            # Warnings of the libraries that are compared with are no errors of ours.
            "-W", "ignore", "--benchmark-only", "--benchmark-quiet",
            f"--benchmark-json={file}"])
        if code != pytest.ExitCode.OK:
            return int(code)
        record = Record(json.loads(file.read_text()))
    command = " ".join(["python -m studies.benchmarks", *sys.argv[1:]])
    run = Run(command, time.monotonic() - start, others)
    given.out.write_text(report.text(run, record))
    for goal in report.goals(record):
        if not goal.met:
            print(f"missed: {goal.what}: {goal.measured}; goal: {goal.goal}")
    print(f"Written to {given.out} after {run.seconds / 60:.1f} minutes.")
    return 0


if __name__ == "__main__":
    sys.exit(main())

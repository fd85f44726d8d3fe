# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import-csv`."""

import pytest

import hmcvt_core as core

from .running import TABLE2, write_raw_bench

OPTIONS = ("--displacement-ratio", "stroke:%", "--engine-speed", "n_engine:rpm", "--engine-torque",
           "M_engine", "--output-speed", "n_output:rpm", "--output-torque", "M_output")


def test_the_file_written_is_the_table_that_the_bench_measured(hmcvt, tmp_path):
    raw, out = tmp_path / "raw.csv", tmp_path / "bench.csv"
    write_raw_bench(raw)
    assert f"8 bench samples written to {out}" in hmcvt(
        "import-csv", raw, "--out", out, *OPTIONS).out
    value = hmcvt("import-csv", raw, "--out", out, *OPTIONS, "--json").json
    assert (value["samples"], value["out"]) == (8, str(out))
    assert value["columns"]["displacement_ratio"] == {"unit": "-", "low": -1.0, "high": 1.0}
    found, table2 = core.read_bench(out), core.read_bench(TABLE2)
    for name in ("displacement_ratio", "engine_speed", "load_torque", "efficiency"):
        assert getattr(found, name) == pytest.approx(getattr(table2, name), rel=1e-12), name

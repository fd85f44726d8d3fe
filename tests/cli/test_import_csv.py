# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import-csv`."""

import pytest

import hmcvt_core as core

from .running import TABLE2, assert_refused, write_raw_bench

OPTIONS = ("--displacement-ratio", "stroke:%", "--engine-speed", "n_engine:rpm", "--engine-torque",
           "M_engine", "--output-speed", "n_output:rpm", "--output-torque", "M_output")


@pytest.fixture
def raw(tmp_path):
    write_raw_bench(tmp_path / "raw.csv")
    return tmp_path / "raw.csv"


def test_the_file_written_is_the_table_that_the_bench_measured(hmcvt, raw, tmp_path):
    out = tmp_path / "bench.csv"
    assert f"8 bench samples written to {out}" in hmcvt(
        "import-csv", raw, "--out", out, *OPTIONS).out
    value = hmcvt("import-csv", raw, "--out", out, *OPTIONS, "--json").json
    assert (value["samples"], value["out"]) == (8, str(out))
    assert value["columns"]["displacement_ratio"] == {"unit": "-", "low": -1.0, "high": 1.0}
    found, table2 = core.read_bench(out), core.read_bench(TABLE2)
    for name in ("displacement_ratio", "engine_speed", "load_torque", "efficiency"):
        assert getattr(found, name) == pytest.approx(getattr(table2, name), rel=1e-12), name


def test_a_forgotten_unit_is_refused_and_nothing_is_written(hmcvt, raw, tmp_path):
    out = tmp_path / "bench.csv"
    options = [option.replace("engine:rpm", "engine") for option in OPTIONS]
    assert_refused(hmcvt("import-csv", raw, "--out", out, *options),
                   "raw.csv: row 2: engine_speed = ", "is it in r/min?")
    assert not out.exists()

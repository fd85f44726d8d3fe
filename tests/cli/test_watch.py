# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt watch` as a command: text, JSON, exit code."""

import hmcvt_core
from studies.watch import stream, well_known

from .running import TABLE2, assert_refused


def test_watch(hmcvt, tmp_path):
    bench, params = tmp_path / "samples.csv", tmp_path / "p.yaml"
    hmcvt_core.save_model(well_known(), params)
    hmcvt_core.write_bench(bench, stream(well_known(), 1, "charge_pump", 0.02))
    done = hmcvt("watch", bench, "--params", params, "--noise", "0.004")
    assert (done.code, done.err) == (4, "")
    assert done.out.startswith("a gap has opened: the bench reads ")
    assert "points below the model (95 %: " in done.out and "noticed at sample" in done.out
    found = hmcvt("watch", bench, "--params", params, "--noise", "0.004", "--json")
    assert found.code == 4 and found.json["open"] and found.json["since_stamp"] is None
    assert found.json["interval"][0] < found.json["size"] < found.json["interval"][1] < 0.0

    done = hmcvt("watch", TABLE2)
    assert done.code == 0 and done.out.startswith("no gap has opened in 8 samples")
    assert_refused(hmcvt("watch", TABLE2, "--false-alarms", "0"), "--false-alarms")
    assert_refused(hmcvt("watch", tmp_path / "none.csv"), "No such file")

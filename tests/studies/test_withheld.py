# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The second half of `make demo`: a withheld cause, sealed, diagnosed and opened."""

import hashlib
import json
import re
import subprocess
import sys

import pytest
from cli.running import ROOT

from studies.withheld import judged, main

SETS = [(("churning",), 0.6), (("charge_pump",), 0.3), (("churning", "gear_mesh"), 0.1)]


@pytest.mark.long
def test_the_seal_stands_before_the_answer(tmp_path):
    run = subprocess.run(
        [
            sys.executable,
            "-m",
            "studies.withheld",
            "--seed",
            "6",
            "--out",
            str(tmp_path),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert run.returncode == 0, run.stderr
    sealed = hashlib.sha256((tmp_path / "truth.json").read_bytes()).hexdigest()
    assert 0 < run.stdout.index(sealed) < run.stdout.index("hmcvt.diagnose reads")
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    hidden = truth["effect"].replace("_", " ")
    assert f"hidden     {hidden}" in run.stdout
    # The bench file does not hold what is hidden.
    header, *rows = (tmp_path / "bench.csv").read_text(encoding="utf-8").splitlines()
    assert truth["effect"] not in header and len(rows) == 96
    # A port pressure drop of 3 points: any answer but this one is a defect.
    assert "RIGHT: port pressure drop was hidden, and is named." in run.stdout
    before, after = map(
        float, re.search(r"([\d.]+) -> ([\d.]+) points rms", run.stdout).groups()
    )
    assert after < 0.3 * before
    assert (tmp_path / "withheld.png").stat().st_size > 20_000


@pytest.mark.parametrize(
    ("verdict", "hidden", "word"),
    [
        ("cause_found", "churning", "RIGHT"),
        ("ambiguous", "churning", "LEADING, NOT SETTLED"),
        ("cause_found", "charge_pump", "WRONG: charge pump was hidden, but churning"),
        ("cause_found", "clutch_drag", "WRONG"),
        ("no_gap", "churning", "MISSED"),
        ("unexplained", "churning", "NOT NAMED"),
    ],
)
def test_a_wrong_answer_is_called_wrong(verdict, hidden, word):
    assert judged(verdict, SETS, hidden).startswith(word)


def test_a_false_companion_is_partly_right():
    sets = [(("churning", "gear_mesh"), 0.7), (("churning",), 0.2)]
    text = judged("cause_found", sets, "churning")
    assert text.startswith("PARTLY RIGHT") and "rank 2" in text


def test_a_seed_out_of_range_is_refused(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["withheld", "--seed", "-1"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "must be 0 to 999999" in capsys.readouterr().err

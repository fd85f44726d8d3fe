# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`--json` prints one JSON value alone, whatever else a command writes.

`fleet` is run with it by tests/fleet, `import-bag` by tests/bag; `node` prints nothing.
"""

import pytest

from .running import POINT, TABLE2

CASES = {  # others: test_commands.py, test_import_csv.py
    "identify": (TABLE2, "--fit", "1,2,4-6", "--out", "p.yaml", "--picture", "fit.png"),
    "predict": (*POINT, "--oil-temperature", "60"),
    "map": ("--steps", "5", "3", "2", "--out", "map.csv", "--picture", "map.svg",
            "--bench", TABLE2),
    "breakdown": (*POINT, "--picture", "losses.svg"),
    "diagnose": (TABLE2, "--report", "report.html", "--save-model", "d.yaml"),
    "next": (TABLE2, "--noise", "0.0085", "--limits", TABLE2),
    "separable": (TABLE2, "--output-speed", "--pressure"),
}


@pytest.mark.parametrize("name", CASES)
def test_one_value_alone(hmcvt, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    arguments = CASES[name]
    done = hmcvt(name, *arguments, "--json")
    assert done.code == 0
    assert done.json
    # What is printed beside the value goes to stderr, and is no more than a note.
    assert all(line.startswith("note: ") for line in done.err.splitlines())
    for option in ("--out", "--picture", "--report", "--save-model"):
        if option in arguments:
            path = tmp_path / arguments[arguments.index(option) + 1]
            assert path.stat().st_size > 0, option

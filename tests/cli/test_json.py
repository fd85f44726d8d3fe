# SPDX-License-Identifier: Apache-2.0
"""`--json` prints one JSON value alone, whatever else a command writes.

`fleet` is run with it by tests/fleet, `import-bag` by tests/bag; `node` prints nothing.
"""

import shutil

import pytest

from hmcvt_core.cli import COMMANDS

from .running import POINT, ROOT, TABLE2, process, write_raw_bench

CASES = {
    "identify": (TABLE2, "--fit", "1,2,4-6", "--out", "p.yaml", "--picture", "fit.png"),
    "identify, compared": (TABLE2, "--gear-efficiency", "0.98,0.97", "--out", "p.yaml"),
    "predict": POINT,
    "predict, file": (TABLE2,),
    "predict, noted": (*POINT, "--oil-temperature", "60"),
    "optimum": (*POINT, "--hold", "output_speed"),
    "map": ("--steps", "5", "3", "2", "--out", "map.csv", "--picture", "map.svg",
            "--bench", TABLE2),
    "map, picture": ("--steps", "5", "3", "2", "--picture", "map.html"),
    "map, file": ("--steps", "5", "3", "2", "--out", "map.csv"),
    "breakdown": (*POINT, "--picture", "losses.svg"),
    "diagnose": (TABLE2, "--report", "report.html", "--save-model", "d.yaml"),
    "separable": (TABLE2, "--output-speed"),
    "import-csv": ("raw.csv", "--out", "bench.csv", "--displacement-ratio", "eps", "--engine-speed",
                   "n:rpm", "--load-torque", "M", "--efficiency", "eta:%"),
}


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_raw_bench(tmp_path / "raw.csv")
    return tmp_path


def test_every_command_is_covered():
    assert {case.partition(",")[0] for case in CASES} == set(COMMANDS) - {"fleet"}


@pytest.mark.parametrize("case", CASES)
def test_one_value_alone(hmcvt, workplace, case):
    name, arguments = case.partition(",")[0], CASES[case]
    done = hmcvt(name, *arguments, "--json")
    assert done.code == 0
    assert done.json
    # What is printed beside the value goes to stderr, and is no more than a note.
    assert all(line.startswith("note: ") for line in done.err.splitlines())
    for option in ("--out", "--picture", "--report", "--save-model"):
        if option in arguments:
            path = workplace / arguments[arguments.index(option) + 1]
            assert path.stat().st_size > 0, option


def test_a_process_prints_the_same(workplace):
    shutil.copy(TABLE2, workplace / "bench.csv")
    done = process("identify", "bench.csv", "--out", "p.yaml", "--json", cwd=workplace,
                   env={"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"})
    assert (done.code, done.err) == (0, "")
    assert done.json["parameters"]
    # No line beside the value: it begins and ends the output.
    assert done.out[0] == "{" and done.out.endswith("}\n")

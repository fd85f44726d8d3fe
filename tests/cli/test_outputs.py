# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Files that a command writes after its answer: no failure of one loses the answer."""

import numpy as np
import pytest

from hmcvt_tools.cli.outputs import Output, write_outputs

from .running import ROOT


@pytest.mark.long
def test_sheet_of_a_table_with_oil_temperature_is_written(hmcvt, tmp_path):
    lines = (ROOT / "data" / "simulated.csv").read_text(encoding="utf-8").splitlines()
    lines = lines[:33]
    oil = np.random.default_rng(1).uniform(45.0, 85.0, len(lines) - 1)
    rows = [f"{row},{value:.1f}" for row, value in zip(lines[1:], oil, strict=True)]
    bench = tmp_path / "oil.csv"
    head = f"{lines[0]},oil_temperature"
    bench.write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    done = hmcvt("diagnose", bench, "--report", tmp_path / "x.pdf")
    assert done.code == 0, done.err
    assert (tmp_path / "x.pdf").read_bytes().startswith(b"%PDF-")
    assert done.out.splitlines()[-1] == f"report written to {tmp_path / 'x.pdf'}"


def _no_key():
    return {}["oil_temperature"]


def _no_space():
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize(
    ("write", "code", "words"),
    [
        (_no_key, 1, "internal failure, please report it: KeyError('oil_temperature')"),
        (_no_space, 2, "No space left on device"),
    ],
)
def test_file_that_fails_is_one_line_and_does_not_hold_up_the_next(
    capsys, write, code, words
):
    written = []
    outputs = (
        Output("report", "x.pdf", write),
        Output("picture", "gap.png", lambda: written.append("gap.png")),
    )
    assert write_outputs(outputs, quiet=False) == code
    shown = capsys.readouterr()
    assert shown.err == f"hmcvt: error: x.pdf: the report is not written: {words}\n"
    assert shown.out == "picture written to gap.png\n"
    assert written == ["gap.png"]

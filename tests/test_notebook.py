# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The notebook, cell by cell, and what a notebook shows of models, fits and diagnoses."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest

import hmcvt_core as hmcvt

pytestmark = pytest.mark.slow

NOTEBOOK = Path(__file__).resolve().parent.parent / "examples" / "first_steps.ipynb"


def shown(code, names):
    """Run a cell; return what it shows, the value of its last line."""
    *body, last = ast.parse(code).body
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    if not isinstance(last, ast.Expr):
        exec(compile(ast.Module([last], []), "cell", "exec"), names)
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_the_notebook_runs_and_shows_pictures_and_text(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    book = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]
    assert all(not cell.get("outputs") for cell in book["cells"])
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    values = [shown(cell, names) for cell in cells]
    texts = [value._repr_html_() for value in values
             if isinstance(value, (hmcvt.EfficiencyModel, hmcvt.Identification, hmcvt.Diagnosis))]
    assert len(texts) == 3 and all(text.startswith("<pre>") for text in texts)
    assert "leakage" in texts[0] and "charge pump" in texts[2]
    pictures = [value._repr_png_() for value in values if hasattr(value, "_repr_png_")]
    assert len(pictures) == 3
    assert all(each.startswith(b"\x89PNG") and len(each) > 10_000 for each in pictures)
    assert (tmp_path / "report.html").is_file() and (tmp_path / "diagnosed.yaml").is_file()


def test_the_map_is_white_for_nothing_only_and_its_line_is_broken_where_the_optimum_jumps():
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    samples = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    axes = model.plot_map(23e3, samples).axes[0]
    fills = np.concatenate([each.get_facecolor() for each in axes.collections
                            if len(each.get_facecolor()) > 5])
    assert fills[:, :3].max() < 0.95
    lines = {line.get_label(): line for line in axes.lines}
    best, = (line for label, line in lines.items() if label == "best at an output speed")
    speed = best.get_xdata()
    steps = np.diff(speed)
    assert np.isnan(speed).sum() >= 1 and np.nanmin(steps) > -0.01 * np.ptp(axes.get_xlim())
    # Of eight tests four have a power within 15 % of 23 kW.
    marks, = (line for label, line in lines.items() if "tests of this power" in label)
    power = samples.load_torque * samples.engine_speed
    assert len(marks.get_xdata()) == (np.abs(power / 23e3 - 1.0) <= 0.15).sum() == 4

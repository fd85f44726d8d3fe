# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The page of a model: the browser answers as Python does, at any width, without a network."""

import csv
import io
import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from cli.running import HM4, TRACTOR, assert_refused, run
from diagnosis.html_browser import clicked, laid_out

import hmcvt_core as hmcvt
import hmcvt_tools
from hmcvt_core.errors import HmcvtError
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_tools.export.c_model import c_model
from hmcvt_tools.export.javascript import javascript
from hmcvt_tools.export.page import MAX_BYTES
from hmcvt_tools.export.vectors import vectors_csv

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
needs_browser = pytest.mark.skipif(
    not any(map(shutil.which, BROWSERS)), reason="needs a browser: chromium"
)
CLOSE = 1e-9
FUNCTIONS = """
const number = text => ({nan: NaN, inf: Infinity})[text] ?? Number(text);
const hmcvt = page.defaultView.eval('hmcvt');
const answer = (name, stage, inputs) => {
  const out = {}, at = inputs.map(number);
  if (name === 'predict') {
    const status = hmcvt.predict(stage, at[0], at[1], at[2], out);
    return [status, out.efficiency, out.output_speed, out.engine_torque, out.power_loss,
            out.inside_domain];
  }
  const status = name === 'optimal_engine_speed'
    ? hmcvt.best_speed(stage, ...at, out) : hmcvt.best_stroke(stage, at[0], at[1], out);
  return [status, out.displacement_ratio, out.efficiency, out.engine_speed, 0, 0];
};
"""


def page_of(model, tmp_path):
    path = tmp_path / "page.html"
    hmcvt_tools.write_page(model, path)
    return path.read_text(encoding="utf-8")


def shipped(name):
    return hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))


def golden(model):
    """Rows of the self-test of the exported C: function, stage, inputs, status and outputs."""
    code = c_model(model)
    text = vectors_csv(model, "double", code.effects)
    return list(csv.reader(io.StringIO(text)))[2:]


@needs_browser
@pytest.mark.parametrize(
    "name",
    [
        "tractor",
        pytest.param("output_coupled", marks=pytest.mark.long),
        # As a stage of the tractor.
        pytest.param("hm4", marks=pytest.mark.long),
        pytest.param("hydrostatic", marks=pytest.mark.long),
    ],
)
def test_answers_in_the_browser_are_those_of_python(name, tmp_path):
    model = shipped(name)
    rows = golden(model)
    asked = [[row[0], int(row[1]), row[2:6]] for row in rows]
    script = f"{FUNCTIONS} return {json.dumps(asked)}.map(row => answer(...row));"
    answers = clicked(page_of(model, tmp_path), tmp_path, script)
    expected = np.array([[float(cell) for cell in row[6:]] for row in rows])
    # JSON has null for NaN.
    given = np.array([[np.nan if v is None else v for v in row] for row in answers])
    np.testing.assert_allclose(given, expected, rtol=CLOSE, atol=CLOSE)


@needs_browser
@pytest.mark.parametrize(
    "name", ["tractor", pytest.param("output_coupled", marks=pytest.mark.long)]
)
def test_losses_by_part_are_those_of_python(name, tmp_path):
    model = shipped(name)
    points = []
    for number, part in enumerate(model.stages.values()):
        for stroke in (-0.7, 0.2, 0.8):
            for load in (40.0, 150.0):
                if np.isfinite(part.efficiency(stroke, 150.0, load)):
                    points.append((number, stroke, 150.0, load))
    assert len(points) > 8
    script = f"{FUNCTIONS} return {json.dumps(points)}.map(at => hmcvt.losses(...at));"
    found = clicked(page_of(model, tmp_path), tmp_path, script)
    stages = list(model.stages)
    for (number, *at), losses in zip(points, found, strict=True):
        expected = model.breakdown(*at, stage=stages[number])
        lost = expected.input_power - expected.output_power
        known = {name.replace("_", " "): v for name, v in expected.losses.items()}
        geared = sum(v for n, v in known.items() if n.startswith(("gear", "planet")))
        for part, watts in losses.items():
            truth = geared if part == "gears" else known[part]
            assert watts == pytest.approx(float(truth), abs=CLOSE * max(lost, 1.0))


@needs_browser
def test_a_model_with_effects_says_how_exact_it_is(tmp_path):
    model = replace(shipped("hm4"), effects=(ChargePump(torque=4.0),))
    page = page_of(model, tmp_path)
    point = [0, 0.5, 150.0, 200.0]
    script = (
        f"{FUNCTIONS} const at = {point};"
        " return [answer('predict', 0, at.slice(1))[1], hmcvt.losses(...at)];"
    )
    efficiency, losses = clicked(page, tmp_path, script)
    assert efficiency == pytest.approx(float(model.efficiency(*point[1:])), abs=2e-3)
    lost = 150.0 * 200.0 * (1.0 / efficiency - 1.0)
    assert sum(losses.values()) == pytest.approx(lost, rel=1e-9)
    assert "gears and effects" in losses
    assert "It holds" in page


@needs_browser
def test_controls_move_the_point_and_fit_a_telephone(tmp_path):
    page = page_of(shipped("tractor"), tmp_path)
    script = """
const value = name => page.getElementById(name).textContent;
const set = (name, to, kind) => {
  page.getElementById(name).value = to;
  page.getElementById(name).dispatchEvent(new page.defaultView.Event(kind));
};
const before = value('efficiency');
set('stage', 3, 'change'); set('stroke', 0.5, 'input');
set('speed', 1800, 'input'); set('load', 150, 'input');
const moved = value('efficiency');
page.getElementById('go').click();
const best = value('efficiency');
set('load', 600, 'input'); set('stage', 0, 'change');
return [before, moved, best, value('warning'), page.querySelectorAll('.bar').length];
"""
    before, moved, best, warning, bars = clicked(page, tmp_path, script)
    part = shipped("tractor").in_stage("HM3")
    speed = 1800.0 * np.pi / 30.0
    assert before != moved
    assert moved == f"{100.0 * float(part.efficiency(0.5, speed, 150.0)):.2f} %"
    optimum = part.optimal_displacement_ratio(speed, 150.0)
    assert best == f"{100.0 * optimum.efficiency:.2f} %"
    assert "the load is not carried" in warning and bars == 0
    layout = laid_out({"page": page}, tmp_path)
    for width in (1280, 390):
        measured = layout.pages[f"page@{width}"]
        assert measured["scroll"] <= width
        assert measured["beyond"] == []
    assert layout.console == []


def test_page_is_one_small_file_without_a_network(tmp_path):
    page = page_of(shipped("tractor"), tmp_path)
    assert len(page.encode()) < MAX_BYTES
    assert not re.search(r"https?://|src=|@import|url\(|fetch\(|XMLHttpRequest", page)
    assert "/*MODEL*/" not in page and "/*FACTS*/" not in page


def test_command(tmp_path):
    out = tmp_path / "tractor.html"
    done = run("page", TRACTOR, "--out", str(out), "--json")
    assert done.code == 0, done.err
    assert done.json["stages"] == ["H0", "HM1", "HM2", "HM3", "HM4"]
    assert out.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    copy = tmp_path / "model.yaml"
    shutil.copy(HM4, copy)
    assert_refused(
        run("page", str(copy), "--out", str(copy)), "is read by this command"
    )


def test_unknown_c_is_refused():
    with pytest.raises(HmcvtError, match="C not translated"):
        javascript("", "union number { int i; };\n")
    with pytest.raises(HmcvtError, match="C not translated: #error"):
        javascript("#error no\n", "")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Scripts and notebook in examples/ give what their pages show (those over ROS 2: tests/ros)."""

import ast
import contextlib
import io
import json
import re
import runpy
import shutil
import sys

import numpy as np
import pytest
from cli.running import ROOT

import hmcvt_core as hmcvt

pytestmark = pytest.mark.usefixtures("coarse_maps")

EXAMPLES = ROOT / "examples"


def printed(name, cwd):
    """Run a script in an empty folder and in this process; what it prints."""
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()) as out,
    ):
        patch.chdir(cwd)
        patch.setattr(sys, "argv", [name])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    return out.getvalue()


def test_every_script_states_its_command():
    # The client is no script: demo.py shows it.
    scripts = sorted(set(EXAMPLES.glob("*.py")) - {EXAMPLES / "bench_player.py"})
    assert len(scripts) >= 5
    for path in scripts:
        text = path.read_text(encoding="utf-8")
        assert f"\n    python examples/{path.name}" in text, path


def test_field_cycle(tmp_path):
    out = printed("field_cycle.py", tmp_path)
    rates = re.findall(r"r/min +([\d.]+) ([\d.]+)$", out, re.MULTILINE)
    assert len(rates) == 6 and all(float(best) <= float(rule) for best, rule in rates)
    kilograms = [float(number) for number in re.findall(r"([\d.]+) kg", out)]
    said, middle, low, high = map(
        float,
        re.search(
            r": ([\d.]+) % less on the model.*: ([\d.]+) % less .* ([\d.]+) to ([\d.]+) %",
            out,
            re.DOTALL,
        ).groups(),
    )
    assert said == pytest.approx(100.0 * (1.0 - kilograms[0] / kilograms[1]), abs=0.1)
    assert low <= middle <= high


def test_offline_study(tmp_path):
    out = printed("offline_study.py", tmp_path)
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    rows = [
        re.split(r"[\s|]+", line.strip())
        for line in out.splitlines()
        if line.count("|") == 3
        and "[" not in line
        and "ratio" not in line
        and "hours" not in line
    ]
    assert len(rows) == 4
    rpm = 3.14159265 / 30.0
    for row in rows:
        output, power, _, *values = (float(word) for word in row)
        fixed, best, saved = values[:3], values[3:6], values[6]
        for speed, stroke, efficiency in (fixed, best):
            torque = 1e3 * power / (speed * rpm)
            # Both strategies give the ground speed asked for, at the efficiency of the model.
            assert model.output_speed(
                stroke, speed * rpm, torque
            ) / rpm == pytest.approx(output, rel=0.01)
            assert 100.0 * model.efficiency(
                stroke, speed * rpm, torque
            ) == pytest.approx(efficiency, abs=0.6)
        assert saved == pytest.approx(100.0 * (1.0 - fixed[2] / best[2]), abs=0.2)
        assert saved >= 0.0
    assert re.search(r"\d+\.\d % saved", out)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("offline_study.py", "--engine-speed", "1000"), "1000 r/min cannot make"),
        (
            ("bag_to_diagnosis.py", "nowhere"),
            "bag_to_diagnosis: nowhere: there is no such bag",
        ),
    ],
)
def test_errors_are_one_line(tmp_path, monkeypatch, words, message):
    if "bag" in words[0]:
        pytest.importorskip("rosbags")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", list(words))
    with pytest.raises(SystemExit, match=f"^{message}") as ended:
        runpy.run_path(str(EXAMPLES / words[0]), run_name="__main__")
    assert isinstance(ended.value.code, str) and "\n" not in ended.value.code


@pytest.mark.long
def test_next_test(tmp_path):
    out = printed("next_test.py", tmp_path)
    page = (ROOT / "docs" / "next-test.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```\n(24 tests.*?)```", page, re.DOTALL)
    # Another processor may move a probability, but not these.
    pattern = re.compile(r"tests: (\w+)|next: (.*);")
    assert pattern.findall(out) == pattern.findall(shown)
    assert len(pattern.findall(out)) == 21
    last = out.splitlines()[-2:]
    assert (
        re.search("tests: pressure_leakage (9|100)", last[0])
        and last[1] == "stop: settled"
    )


def test_fmu_tractor(tmp_path):
    pytest.importorskip("fmpy", reason="needs the extra export")
    if not any(shutil.which(name) for name in ("cc", "gcc", "clang")):
        pytest.skip("no C compiler")
    out = printed("fmu_tractor.py", tmp_path).splitlines()
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```\n( +s +wanted.*?)```", page, re.DOTALL)
    assert len(shown.splitlines()) == 7
    for line in shown.splitlines():
        assert line in out
    assert out[-1] == "largest difference between FMU and Python at 1201 steps: 0"
    kilojoules = [float(number) for number in re.findall(r"([\d.]+) kJ", out[-2])]
    assert kilojoules[0] == pytest.approx(kilojoules[1] + kilojoules[2], abs=0.2)


def test_own_system_finds_the_hidden_effect(tmp_path):
    out = printed("own_system.py", tmp_path)
    page = (ROOT / "docs" / "add-a-system.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```\n(Probably .*?)```", page, re.DOTALL)
    assert out.startswith(shown)
    assert re.search(r"^sets +bearing drag (> )?\d+ %", out, re.MULTILINE)


@pytest.mark.long
def test_bag_to_diagnosis(tmp_path):
    pytest.importorskip("rosbags")
    out = printed("bag_to_diagnosis.py", tmp_path)
    found = hmcvt.read_bench(tmp_path / "diagnosis" / "samples.csv")
    true = hmcvt.read_bench(hmcvt.data_path("data/simulated.csv"))
    # The bag gives back the tests that it was made from, in their order.
    assert len(found) == len(true) == 96
    assert found.efficiency == pytest.approx(true.efficiency, rel=1e-3)
    assert found.output_speed == pytest.approx(true.output_speed, rel=1e-3)
    assert "charge pump" in out
    assert "charge pump" in (tmp_path / "diagnosis" / "report.html").read_text(
        encoding="utf-8"
    )
    fit = hmcvt.identify(true)
    saved = hmcvt.load_model(tmp_path / "diagnosis" / "model.yaml")
    assert saved.parameters.leakage == pytest.approx(fit.parameters.leakage, rel=0.05)


def shown(code, names):
    """Run a cell; return what it shows, the value of its last line."""
    *body, last = ast.parse(code).body
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    if not isinstance(last, ast.Expr):
        exec(compile(ast.Module([last], []), "cell", "exec"), names)
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.long
def test_notebook(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    book = json.loads((EXAMPLES / "first_steps.ipynb").read_text(encoding="utf-8"))
    cells = [
        "".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"
    ]
    assert all(not cell.get("outputs") for cell in book["cells"])
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    values = [shown(cell, names) for cell in cells]
    texts = [
        value._repr_html_()
        for value in values
        if isinstance(
            value, (hmcvt.EfficiencyModel, hmcvt.Identification, hmcvt.Diagnosis)
        )
    ]
    assert len(texts) == 3 and all(text.startswith("<pre>") for text in texts)
    assert "leakage" in texts[0] and "charge pump" in texts[2]
    pictures = [value._repr_png_() for value in values if hasattr(value, "_repr_png_")]
    assert len(pictures) == 3
    assert all(each.startswith(b"\x89PNG") and len(each) > 10_000 for each in pictures)
    assert (tmp_path / "report.html").is_file() and (
        tmp_path / "diagnosed.yaml"
    ).is_file()


def test_map_has_colour_and_a_line_of_optima(
    table2,
):
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    axes = model.plot_map(23e3, table2).axes[0]
    fills = np.concatenate(
        [
            each.get_facecolor()
            for each in axes.collections
            if len(each.get_facecolor()) > 5
        ]
    )
    # No fill is close to white.
    assert fills[:, :3].min(axis=1).max() < 0.95
    lines = {line.get_label(): line for line in axes.lines}
    (best,) = (
        line for label, line in lines.items() if label == "best at an output speed"
    )
    speed = best.get_xdata()
    steps = np.diff(speed)
    assert np.isnan(speed).sum() >= 1 and np.nanmin(steps) > -0.01 * np.ptp(
        axes.get_xlim()
    )
    # Of eight tests four have a power within 15 % of 23 kW.
    (marks,) = (line for label, line in lines.items() if "tests of this power" in label)
    power = table2.load_torque * table2.engine_speed
    assert len(marks.get_xdata()) == (np.abs(power / 23e3 - 1.0) <= 0.15).sum() == 4


@pytest.mark.parametrize(
    ("name", "package", "answer"),
    [
        ("electric_drive.py", "numpy", "Probably magnet weakening"),
        ("fmu_system.py", "fmpy", "Probably further leakage"),
        ("mujoco_joint.py", "mujoco", "Probably coulomb friction"),
    ],
)
def test_any_simulator(name, package, answer, tmp_path):
    pytest.importorskip(package, reason=f"needs {package}: pip install {package}")
    if name.startswith("fmu") and not any(map(shutil.which, ("cc", "gcc", "clang"))):
        pytest.skip("needs a C compiler")
    assert len((EXAMPLES / name).read_text(encoding="utf-8").splitlines()) <= 150
    assert printed(name, tmp_path).startswith(answer)

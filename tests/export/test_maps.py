# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Maps for MATLAB, read by SciPy and by Octave, and the A2L description."""

import re
import shutil
import subprocess

import numpy as np
import pytest
import scipy.io
from cli.running import HM4, TRACTOR, assert_refused, run

import hmcvt_core as hmcvt
import hmcvt_tools

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")


@pytest.fixture(scope="module")
def model():
    return hmcvt.load_model(TRACTOR)


@pytest.fixture(scope="module")
def written(model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    hmcvt_tools.export_mat(model, folder / "tractor.mat")
    hmcvt_tools.export_mat(model, folder / "tractor.m")
    return folder


def test_mat_holds_axes_units_and_tables(model, written):
    data = scipy.io.loadmat(
        written / "tractor.mat", squeeze_me=True, struct_as_record=False
    )["hmcvt"]
    assert data.fingerprint == model.fingerprint
    assert data.units.engine_speed == "rad/s"
    assert data.units.power_loss == "W"
    assert [stage.name for stage in data.stages] == list(model.stages)
    grid = np.meshgrid(
        data.displacement_ratio, data.engine_speed, data.load_torque, indexing="ij"
    )
    for stage in data.stages:
        part = model.stages[stage.name]
        np.testing.assert_array_equal(stage.efficiency, part.efficiency(*grid))
        np.testing.assert_array_equal(stage.output_speed, part.output_speed(*grid))
        np.testing.assert_array_equal(stage.power_loss, part.power_loss(*grid))
        assert 0.0 < stage.efficiency_error < 0.05
    assert data.stages[4].efficiency_error < 0.002


@pytest.mark.skipif(OCTAVE is None, reason="no Octave")
def test_octave_reads_and_interpolates(model, written):
    lines = """
load tractor.mat; from_mat = hmcvt; clear hmcvt; tractor; assert(isequaln(hmcvt, from_mat));
s = hmcvt.stages(5);
loss = interpn(hmcvt.displacement_ratio, hmcvt.engine_speed, hmcvt.load_torque, s.power_loss, ...
               0.31, 151.5, 223.0);
printf("%s %s %.6f\\n", hmcvt.fingerprint, s.name, 223.0 / (223.0 + loss / 151.5));
"""
    done = subprocess.run(
        [OCTAVE, "--no-gui", "--quiet", "--eval", lines],
        cwd=written,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 0, done.stderr
    fingerprint, name, efficiency = done.stdout.split()
    assert (fingerprint, name) == (model.fingerprint, "HM4")
    exact = model.efficiency(0.31, 151.5, 223.0, stage="HM4")
    assert abs(float(efficiency) - exact) < 0.002


def test_command_writes_maps(tmp_path):
    for name in ("hm4.mat", "hm4.m"):
        out = tmp_path / name
        done = run("export", "--params", HM4, "--format", "mat", "--out", out)
        assert done.code == 0, done.err
        assert out.stat().st_size > 10_000


def test_bad_input_is_one_line_and_writes_nothing(tmp_path):
    base = ("export", "--params", HM4, "--format", "mat", "--out")
    (tmp_path / "a.mat").mkdir()
    assert_refused(run(*base, tmp_path / "a.mat"), "is a folder")
    assert_refused(run(*base, tmp_path / "a.csv"), ".mat or .m")
    assert_refused(run(*base, tmp_path / "no" / "b.mat"), "b.mat")
    assert_refused(run("export", "--params", HM4, "--format", "mat"), "--out")
    model = hmcvt.load_model(HM4)
    published = hmcvt.EfficiencyModel(
        model.stage, model.parameters, formulation="published"
    )
    with pytest.raises(hmcvt.InputError, match="'published' is not exported"):
        hmcvt_tools.export_mat(published, tmp_path / "b.mat")
    assert [path.name for path in tmp_path.iterdir()] == ["a.mat"]


@pytest.mark.parametrize("precision", ["double", "single"])
def test_a2l_names_parameters_and_outputs(tmp_path, model, precision):
    hmcvt_tools.export_c(model, tmp_path / "c", precision)
    text = (tmp_path / "c" / "hmcvt_model.a2l").read_text()
    begun = re.findall(r"/begin (\w+)", text)
    assert sorted(begun) == sorted(re.findall(r"/end (\w+)", text))
    parameters = re.findall(r"/begin CHARACTERISTIC (\S+)", text)
    assert parameters == [
        f"hmcvt_calibration.{name}"
        for name in ("leakage", "motor_damping", "pump_damping")
    ]
    assert begun.count("MEASUREMENT") == 5
    kind = {"double": "FLOAT64_IEEE", "single": "FLOAT32_IEEE"}[precision]
    assert f"FNC_VALUES 1 {kind}" in text
    offset = {"double": 16, "single": 8}[precision]
    assert f'SYMBOL_LINK "hmcvt_calibration" {offset}' in text
    assert model.fingerprint in text
    # Six decimals of m3/(s Pa) would show the leakage as 0.
    (shown,) = re.findall(r'RAT_FUNC "%10.6" "(.*)"\n *COEFFS 0 1 0 0 0 (\S+)', text)
    assert shown[0] == "cm3/(min bar)"
    stored = model.parameters.leakage
    assert float(shown[1]) * stored == pytest.approx(stored * 1e6 * 60.0 * 1e5)
    assert float(shown[1]) * stored > 1.0

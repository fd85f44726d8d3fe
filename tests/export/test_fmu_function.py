# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An FMU as a function of operating points, and as a system whose parameters are effects."""

import runpy
from dataclasses import replace

import numpy as np
import pytest
from cli.running import ROOT

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import needs_compiler

pytest.importorskip("fmpy")
pytestmark = needs_compiler

POINTS = {
    "stroke": np.array([-0.5, 0.2, 0.8]),
    "engine_speed": np.array([130.0, 160.0, 210.0]),
    "load_torque": np.array([100.0, 150.0, 250.0]),
}


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(ROOT / "examples" / "fmu_system.py"))


@pytest.fixture(scope="module", params=[2, 3])
def path(request, example, tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "model.fmu"
    hmcvt_tools.export_fmu(example["MODEL"], path, fmi=request.param)
    return path


def test_answers_are_those_of_the_model(path, example):
    function = hmcvt_tools.FmuFunction(
        path, ("efficiency",), variables={"stroke": "displacement_ratio"}
    )
    model = example["MODEL"]
    expected = model.efficiency(*POINTS.values())
    for _ in range(2):  # the second time after a reset
        answer = function(POINTS, leakage=model.parameters.leakage)
        np.testing.assert_allclose(answer["efficiency"], expected, rtol=1e-12)
    leaking = replace(model.parameters, leakage=2.0 * model.parameters.leakage)
    answer = function(POINTS, leakage=leaking.leakage)
    expected = replace(model, parameters=leaking).efficiency(*POINTS.values())
    np.testing.assert_allclose(answer["efficiency"], expected, rtol=1e-12)


def test_hidden_parameter_is_named(path, example):
    machine = example["system"](path)
    diagnosis = hmcvt.diagnose_system(machine, example["campaign"](machine, seed=1))
    assert diagnosis.sets[0].effects == ("further_leakage",)
    size = diagnosis.causes[0].parameters["further_leakage"]
    true = 0.4 * example["MODEL"].parameters.leakage
    assert size["value"] == pytest.approx(true, abs=3.0 * size["standard_error"])


def test_what_the_fmu_lacks_is_named(path, tmp_path):
    with pytest.raises(hmcvt.InputError, match="has no variable heat"):
        hmcvt_tools.FmuFunction(path, ("heat",))
    function = hmcvt_tools.FmuFunction(path, ("efficiency",))
    with pytest.raises(hmcvt.InputError, match="has no variable stroke"):
        function(POINTS)
    broken = tmp_path / "broken.fmu"
    broken.write_text("no archive")
    with pytest.raises(hmcvt.InputError, match=r"broken\.fmu: cannot be loaded"):
        hmcvt_tools.FmuFunction(broken, ("efficiency",))

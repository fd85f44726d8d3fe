# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The choice of the stage in C is that of the command line, with hysteresis."""

import ctypes
import os
import subprocess

import numpy as np
import pytest
from cli.running import HM4, TRACTOR

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import compile_c, needs_compiler
from hmcvt_core.transmission.ranges import ENGINE_SPEED_LIMITS
from hmcvt_tools.export.stage_choice import HYSTERESIS, random_demands

DEMANDS = int(os.environ.get("HMCVT_STAGE_DEMANDS", "1000"))
"""The page of the export states the outcome of 10,000."""
FMU_DEMANDS = DEMANDS // 5

pytestmark = needs_compiler


class Optimum(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_double)
        for name in ("displacement_ratio", "efficiency", "engine_speed")
    ]


class Choice(ctypes.Structure):
    _fields_ = [("stage", ctypes.c_int), ("best", Optimum)]


@pytest.fixture(scope="module")
def tractor():
    return hmcvt.load_model(TRACTOR)


@pytest.fixture(scope="module")
def folder(tractor, tmp_path_factory):
    path = tmp_path_factory.mktemp("c") / "tractor"
    hmcvt_tools.export_c(tractor, path)
    return path


@pytest.fixture(scope="module")
def choose(folder):
    library = compile_c(
        folder,
        folder / "stage.so",
        *("-O2", "-fPIC", "-shared", "hmcvt_model.c", "hmcvt_stage.c"),
    )
    function = ctypes.CDLL(str(library)).hmcvt_choose_stage
    function.argtypes = [
        ctypes.c_int,
        *[ctypes.c_double] * 5,
        ctypes.POINTER(Choice),
    ]

    def chosen(engaged, hysteresis, speed, power, limits=ENGINE_SPEED_LIMITS):
        out = Choice()
        status = function(engaged, hysteresis, speed, power, *limits, out)
        return status, out

    return chosen


def test_the_stage_is_that_of_the_command_line(tractor, choose):
    names = list(tractor.stages)
    engaged = -1
    stages = set()
    kept = 0
    for number, (speed, power) in enumerate(
        random_demands(tractor, DEMANDS, 5).tolist()
    ):
        hysteresis = HYSTERESIS[number % len(HYSTERESIS)]
        best = tractor.optimal_drive(
            speed,
            power,
            stage=None if engaged < 0 else names[engaged],
            hysteresis=hysteresis,
        )
        status, choice = choose(engaged, hysteresis, speed, power)
        if best.stage is None:
            assert (status, choice.stage) == (1, -1)
            assert np.isnan(choice.best.efficiency)
        else:
            assert (status, choice.stage) == (0, names.index(best.stage)), number
            assert choice.best.efficiency == pytest.approx(best.efficiency, abs=1e-9)
            kept += choice.stage == engaged
        engaged = choice.stage
        stages.add(engaged)
    assert stages >= set(range(len(names)))
    assert kept > DEMANDS / 20


def test_the_self_test_of_the_folder_passes(folder):
    program = compile_c(
        folder,
        folder / "check_stage",
        *("hmcvt_model.c", "hmcvt_stage.c", "check_stage.c"),
    )
    done = subprocess.run(
        [program, "stage_vectors.csv"], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout
    assert "choices of a stage agree" in done.stdout


def test_wrong_input_is_answered_by_a_status(choose):
    for engaged in (-2, 5):
        assert choose(engaged, 0.0, 100.0, 4e4)[0] == 3
    for hysteresis in (-0.1, 1.1, float("nan")):
        assert choose(-1, hysteresis, 100.0, 4e4)[0] == 2
    for speed, power in ((0.0, 4e4), (100.0, -1.0), (float("nan"), 4e4)):
        status, choice = choose(-1, 0.0, speed, power)
        assert (status, choice.stage) == (2, -1)


def test_one_stage_has_no_choice(tmp_path):
    hmcvt_tools.export_c(hmcvt.load_model(HM4), tmp_path / "c")
    assert not (tmp_path / "c" / "hmcvt_stage.h").exists()


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_fmu_chooses_alike(tractor, tmp_path, fmi):
    fmpy = pytest.importorskip("fmpy")
    path = tmp_path / "tractor.fmu"
    hmcvt_tools.export_fmu(tractor, path, fmi)
    names = list(tractor.stages)
    count = FMU_DEMANDS
    demands = random_demands(tractor, count, 6)
    engaged = np.arange(count) % len(names)
    signals = np.zeros(
        count,
        dtype=[
            ("time", np.float64),
            ("demanded_output_speed", np.float64),
            ("demanded_output_power", np.float64),
            ("stage", np.int32),
        ],
    )
    signals["time"] = np.arange(float(count))
    signals["demanded_output_speed"] = demands[:, 0]
    signals["demanded_output_power"] = demands[:, 1]
    signals["stage"] = engaged
    inputs = signals.dtype.names[1:]
    result = fmpy.simulate_fmu(
        str(path),
        fmi_type="CoSimulation",
        start_values={"hysteresis": 0.05},
        input=signals,
        output=["optimal_stage", "optimal_engine_speed", *inputs],
        start_time=0.0,
        stop_time=count - 1.0,
        step_size=1.0,
        output_interval=1.0,
    )
    assert len(result) == count
    for row in result:
        best = tractor.optimal_drive(
            float(row["demanded_output_speed"]),
            float(row["demanded_output_power"]),
            stage=names[row["stage"]],
            hysteresis=0.05,
        )
        if best.stage is None:
            assert row["optimal_stage"] == -1
            assert np.isnan(row["optimal_engine_speed"])
        else:
            assert row["optimal_stage"] == names.index(best.stage)
            assert row["optimal_engine_speed"] == pytest.approx(
                best.engine_speed, rel=1e-6
            )

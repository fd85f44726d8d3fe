# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The FMU is valid, answers as Python does, and is written whole or not at all."""

import ctypes
import os
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli.running import HM4, TRACTOR, assert_refused, run

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import WARNINGS, needs_compiler
from export.points import bits_differ
from hmcvt_tools.export.fmi_variables import fmu_variables

fmpy = pytest.importorskip("fmpy")
validation = pytest.importorskip("fmpy.validation")

STEPS = 1001
INPUTS = (
    ("time", np.float64),
    ("displacement_ratio", np.float64),
    ("engine_speed", np.float64),
    ("load_torque", np.float64),
    ("stage", np.int32),
)
OUTPUTS = (
    "efficiency",
    "output_speed",
    "engine_torque",
    "power_loss",
    "optimal_displacement_ratio",
    "status",
    "efficiency_std",
    "inside_domain",
)
HEADERS = Path(fmpy.__file__).parent / "c-code"

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def tractor():
    return hmcvt.load_model(TRACTOR)


@pytest.fixture(scope="module", params=[2, 3])
def fmi(request):
    return request.param


@pytest.fixture(scope="module")
def fmu(tractor, fmi, tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / f"tractor{fmi}.fmu"
    hmcvt_tools.export_fmu(tractor, path, fmi)
    return path


def course():
    """Return inputs over ten seconds: pull, overrun, every stage."""
    time = np.linspace(0.0, 10.0, STEPS)
    rows = np.zeros(STEPS, dtype=list(INPUTS))
    rows["time"] = time
    rows["displacement_ratio"] = np.sin(1.3 * time)
    rows["engine_speed"] = 150.0 + 60.0 * np.sin(0.7 * time)
    rows["load_torque"] = 150.0 + 300.0 * np.sin(0.4 * time)
    rows["stage"] = (np.arange(STEPS) // 201) % 5
    return rows


def expected(model, rows):
    """Return what Python says of the inputs."""
    names = np.array(list(model.stages))[rows["stage"]]
    point = (rows["displacement_ratio"], rows["engine_speed"], rows["load_torque"])
    return {
        "efficiency": model.efficiency(*point, stage=names),
        "output_speed": model.output_speed(*point, stage=names),
        "power_loss": model.power_loss(*point, stage=names),
    }


def simulate(path, rows):
    """Simulate a course; the result holds the inputs that the importer sets, too."""
    return fmpy.simulate_fmu(
        str(path),
        fmi_type="CoSimulation",
        input=rows,
        output=[*OUTPUTS, *rows.dtype.names[1:]],
        start_time=0.0,
        stop_time=10.0,
        step_size=0.01,
        output_interval=0.01,
    )


def test_fmpy_finds_no_fault(fmu):
    assert validation.validate_fmu(str(fmu)) == []


def test_co_simulation_equals_python(tractor, fmu):
    result = simulate(fmu, course())
    assert len(result) == STEPS
    values = expected(tractor, result)
    for name, column in values.items():
        assert bits_differ(result[name], column) == 0
    assert np.array_equal(result["status"], np.isnan(values["efficiency"]))
    assert set(result["stage"]) == {0, 1, 2, 3, 4}


def test_model_exchange_equals_python(tractor, fmu):
    rows = course()
    held = rows[rows["stage"] == 4].copy()
    held["time"] -= held["time"][0]
    # The importer interpolates inputs between the rows: compare at what it then sets.
    inputs = ("displacement_ratio", "engine_speed", "load_torque")
    result = fmpy.simulate_fmu(
        str(fmu),
        fmi_type="ModelExchange",
        start_values={"stage": 4},
        input=held,
        output=[*OUTPUTS, *inputs],
        start_time=0.0,
        stop_time=float(held["time"][-1]),
        output_interval=0.01,
    )
    part = tractor.stages["HM4"]
    point = [result[name] for name in inputs]
    assert bits_differ(result["efficiency"], part.efficiency(*point)) == 0
    assert bits_differ(result["output_speed"], part.output_speed(*point)) == 0


def test_every_stage_has_an_answer_at_the_start_values():
    for name in ("hm4", "hydrostatic", "output_coupled", "tractor"):
        model = hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))
        variables = fmu_variables(model, has_tables=False)
        start = {variable.name: variable.start for variable in variables}
        point = [start[name] for name, _ in INPUTS[1:4]]
        for part in model.stages.values():
            assert np.isfinite(part.efficiency(*point))


def test_only_functions_of_fmi_are_visible(fmu, fmi, tmp_path):
    """So two FMUs in one process do not call into one another."""
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    (library,) = (tmp_path / "binaries").rglob("*.so")
    loaded = ctypes.CDLL(str(library))
    assert hasattr(loaded, f"fmi{fmi}GetVersion")
    assert not hasattr(loaded, "hmcvt_predict_with")


def instance(path, fmi):
    """Return an instance of an FMU at its start values, and its value references."""
    description = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path))
    kind = __import__(f"fmpy.fmi{fmi}", fromlist=["fmi"])
    slave = getattr(kind, f"FMU{fmi}Slave")(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="unit",
    )
    slave.instantiate()
    if fmi == 2:
        slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    references = {
        variable.name: variable.valueReference
        for variable in description.modelVariables
    }
    return slave, references, folder


def test_every_output_at_a_point_and_other_parameters(tractor, fmu, fmi):
    slave, references, folder = instance(fmu, fmi)
    set_real = slave.setReal if fmi == 2 else slave.setFloat64
    get_real = slave.getReal if fmi == 2 else slave.getFloat64
    set_integer = slave.setInteger if fmi == 2 else slave.setInt32
    try:
        for name, value in (
            ("displacement_ratio", 0.3),
            ("engine_speed", 160.0),
            ("load_torque", 220.0),
        ):
            set_real([references[name]], [value])
        set_integer([references["stage"]], [3])
        part = tractor.stages["HM3"]
        best = part.optimal_displacement_ratio(160.0, 220.0)
        point = (0.3, 160.0, 220.0)
        values = {
            "efficiency": part.efficiency(*point),
            "output_speed": part.output_speed(*point),
            "power_loss": part.power_loss(*point),
            "optimal_displacement_ratio": best.displacement_ratio,
        }
        for name, value in values.items():
            assert get_real([references[name]]) == [value]
        set_real([references["leakage"]], [6e-11])
        set_real([references["motor_damping"]], [0.1])
        calibrated = hmcvt.EfficiencyModel(
            part.stage,
            hmcvt.HydraulicParameters(6e-11, 0.1, tractor.parameters.pump_damping),
        )
        assert get_real([references["efficiency"]]) == [calibrated.efficiency(*point)]
        with pytest.raises(Exception, match=r"(?i)failed"):
            set_real([references["efficiency"]], [0.5])
    finally:
        slave.terminate()
        slave.freeInstance()
        shutil.rmtree(folder)


def test_state_can_be_kept(fmu, fmi):
    slave, references, folder = instance(fmu, fmi)
    set_real = slave.setReal if fmi == 2 else slave.setFloat64
    get_real = slave.getReal if fmi == 2 else slave.getFloat64
    get, put, free = ("getFMUState", "setFMUState", "freeFMUState")
    if fmi == 2 and not hasattr(slave, get):
        get, put, free = ("getFMUstate", "setFMUstate", "freeFMUstate")
    try:
        set_real([references["load_torque"]], [123.0])
        state = getattr(slave, get)()
        set_real([references["load_torque"]], [321.0])
        getattr(slave, put)(state)
        getattr(slave, free)(state)
        assert get_real([references["load_torque"]]) == [123.0]
        slave.reset()
        assert get_real([references["load_torque"]]) == [50.0]
    finally:
        slave.terminate()
        slave.freeInstance()
        shutil.rmtree(folder)


def test_variables_are_those_of_the_contract(fmu, tractor):
    description = fmpy.read_model_description(str(fmu))
    by_causality = {}
    for variable in description.modelVariables:
        by_causality.setdefault(variable.causality, {})[variable.name] = variable
    inputs = by_causality["input"]
    assert list(inputs) == [
        "displacement_ratio",
        "engine_speed",
        "load_torque",
        "stage",
        "demanded_output_speed",
        "demanded_output_power",
    ]
    assert inputs["stage"].type in ("Integer", "Int32")
    choice = {"optimal_stage", "optimal_engine_speed"}
    assert set(by_causality["output"]) == set(OUTPUTS) | choice
    parameters = by_causality["parameter"]
    hydraulic = ["leakage", "motor_damping", "pump_damping"]
    of_choice = ["hysteresis", "lowest_engine_speed", "highest_engine_speed"]
    assert list(parameters) == [*hydraulic, *of_choice]
    for name, variable in parameters.items():
        assert variable.variability == "tunable"
        if name in hydraulic:
            assert float(variable.start) == getattr(tractor.parameters, name)
        assert variable.unit
    assert by_causality["output"]["output_speed"].unit == "rad/s"
    assert by_causality["output"]["power_loss"].unit == "W"


def test_no_python_inside_and_sources_compile(fmu, fmi, tmp_path):
    with zipfile.ZipFile(fmu) as archive:
        names = archive.namelist()
        archive.extractall(tmp_path)
    assert not [name for name in names if name.endswith(".py")]
    assert "modelDescription.xml" in names
    sources = ["hmcvt_model.c", "hmcvt_stage.c", "hmcvt_unit.c", f"fmi{fmi}.c"]
    done = subprocess.run(
        [
            "gcc",
            "-std=c99",
            *WARNINGS,
            f"-isystem{HEADERS}",
            "-shared",
            "-fPIC",
            *sources,
            "-lm",
            "-o",
            "x.so",
        ],
        cwd=tmp_path / "sources",
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


def test_same_model_gives_the_same_bytes(tmp_path, fmu, fmi, tractor):
    hmcvt_tools.export_fmu(tractor, tmp_path / "again.fmu", fmi)
    assert (tmp_path / "again.fmu").read_bytes() == fmu.read_bytes()


def test_command_writes_an_fmu(tmp_path):
    out = tmp_path / "hm4.fmu"
    done = run("export", "--params", HM4, "--format", "fmu", "--fmi", "3", "--out", out)
    assert done.code == 0, done.err
    assert fmpy.read_model_description(str(out)).fmiVersion == "3.0"
    assert [path.name for path in tmp_path.iterdir()] == ["hm4.fmu"]


def test_bad_input_is_one_line_and_writes_nothing(tmp_path, monkeypatch):
    base = ("export", "--params", HM4, "--format", "fmu", "--out")
    (tmp_path / "folder").mkdir()
    assert_refused(run(*base, tmp_path / "folder"), "is a folder")
    assert_refused(run(*base, tmp_path / "no" / "a.fmu"), "a.fmu")
    assert_refused(run(*base, tmp_path / "a.fmu", "--fmi", "1"), "--fmi")
    assert_refused(run(*base, tmp_path / "a.fmu", "--stage", "HM9"), "'HM9'")
    model = hmcvt.load_model(HM4)
    with pytest.raises(hmcvt.InputError, match="fmi = 4; there is 2, 3"):
        hmcvt_tools.export_fmu(model, tmp_path / "a.fmu", 4)
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert_refused(run(*base, tmp_path / "a.fmu"), "no C compiler")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_a_compiler_that_fails_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "false")
    out = tmp_path / "a.fmu"
    done = run("export", "--params", HM4, "--format", "fmu", "--out", out)
    assert_refused(done, "false fails: no message")
    monkeypatch.setenv("CC", "no-such-compiler")
    done = run("export", "--params", HM4, "--format", "fmu", "--out", out)
    assert_refused(done, "CC = 'no-such-compiler' is not a program")
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("CC", "cc -fstack-protector")
    done = run("export", "--params", HM4, "--format", "fmu", "--out", out)
    assert done.code == 0, done.err


def test_without_fmpy_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    out = tmp_path / "a.fmu"
    done = run("export", "--params", HM4, "--format", "fmu", "--out", out)
    assert_refused(done, 'pip install "hmcvt_ros[export]"')
    assert list(tmp_path.iterdir()) == []


def test_published_formulas_are_refused(tmp_path):
    model = hmcvt.load_model(HM4)
    published = hmcvt.EfficiencyModel(
        model.stage, model.parameters, formulation="published"
    )
    for fmi in (2, 3):
        with pytest.raises(hmcvt.InputError, match="'published' is not exported"):
            hmcvt_tools.export_fmu(published, tmp_path / "a.fmu", fmi)
    assert list(tmp_path.iterdir()) == []


# --- Windows -------------------------------------------------------------------------------------

CROSS = shutil.which("x86_64-w64-mingw32-gcc")
WINE = shutil.which("wine64") or shutil.which("wine64", path="/usr/lib/wine")


@pytest.mark.skipif(not (CROSS and WINE), reason="no mingw-w64 or no wine")
def test_windows_library_answers_under_wine(tmp_path, tractor):
    path = tmp_path / "hm4.fmu"
    model = hmcvt.load_model(HM4)
    hmcvt_tools.export_fmu(model, path, 2)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    (library,) = (tmp_path / "binaries" / "win64").iterdir()
    description = (tmp_path / "modelDescription.xml").read_text()
    (token,) = re.findall('guid="([^"]+)"', description)
    program = tmp_path / "dll_check.exe"
    source = Path(__file__).with_name("dll_check.c")
    subprocess.run(
        [CROSS, f"-I{HEADERS}", source, "-o", program], check=True, timeout=60
    )
    rng = np.random.default_rng(1)
    points = np.column_stack(
        [
            rng.uniform(-1.0, 1.0, 50),
            rng.uniform(20.0, 300.0, 50),
            rng.uniform(10.0, 400.0, 50),
        ]
    )
    done = subprocess.run(
        [WINE, program, library.name, token, *map(repr, points.ravel().tolist())],
        cwd=library.parent,
        capture_output=True,
        text=True,
        timeout=110,
        env={**os.environ, "WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all"},
    )
    assert done.returncode == 0, done.stderr
    values = np.array([float(line) for line in done.stdout.split()])
    assert bits_differ(values, model.efficiency(*points.T)) == 0

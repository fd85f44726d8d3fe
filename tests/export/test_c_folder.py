# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The folder of C: it compiles anywhere, tests itself, and is written whole or not at all."""

import errno
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import pytest
from cli.running import HM4, TRACTOR, assert_refused, run

import hmcvt_core as hmcvt
import hmcvt_tools
from export.c_library import COMPILER, compile_c, needs_compiler
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_tools.export.c_folder import _oil
from hmcvt_tools.export.folder import write_folder

COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name) is not None]
SANITIZERS = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FLAGS = {"plain": ("-O0",), "optimised": ("-O2",), "sanitized": ("-O1", *SANITIZERS)}
FILES = {
    "README.md",
    "check.c",
    "hmcvt_model.a2l",
    "hmcvt_model.c",
    "hmcvt_model.h",
    "vectors.csv",
}


def self_test(folder, *flags, compiler=COMPILER):
    """Build and run the self-test of a folder."""
    program = compile_c(
        folder, folder / "check", *flags, "hmcvt_model.c", "check.c", compiler=compiler
    )
    return subprocess.run(
        [program, "vectors.csv"], cwd=folder, capture_output=True, text=True
    )


@needs_compiler
@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize(
    "name",
    [
        # The tractor has stages of these two.
        pytest.param("hm4", marks=pytest.mark.long),
        pytest.param("hydrostatic", marks=pytest.mark.long),
        "output_coupled",
        "tractor",
    ],
)
def test_self_test_passes(exported, name, precision):
    built = exported(name, precision)
    done = self_test(built.folder, *FLAGS["sanitized"])
    assert done.stderr == ""
    assert done.returncode == 0, done.stdout
    assert done.stdout.startswith(f"model {built.model.fingerprint}: ")


@pytest.mark.parametrize("flags", FLAGS)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_every_compiler_builds_it(exported, compiler, flags):
    done = self_test(exported("tractor").folder, *FLAGS[flags], compiler=compiler)
    assert done.stderr == ""
    assert done.returncode == 0, done.stdout


def test_self_test_sees_a_wrong_digit(exported, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(exported("hm4").folder, folder)
    lines = (folder / "vectors.csv").read_text().splitlines()
    cells = lines[20].split(",")
    assert cells[0] == "predict" and cells[7] != "nan"
    cells[7] = repr(float(cells[7]) * (1.0 + 1e-15))
    lines[20] = ",".join(cells)
    (folder / "vectors.csv").write_text("\n".join(lines) + "\n")
    done = self_test(folder)
    assert done.returncode == 1
    assert done.stdout.startswith("row 19 differs: predict of stage 0")


def test_self_test_sees_another_model(exported, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(exported("hm4").folder, folder)
    shutil.copy(exported("hydrostatic").folder / "vectors.csv", folder)
    done = self_test(folder)
    assert done.returncode == 1
    assert "the vectors are not those of model" in done.stdout


def test_self_test_needs_its_vectors(exported, tmp_path):
    folder = tmp_path / "c"
    shutil.copytree(exported("hm4").folder, folder)
    (folder / "vectors.csv").unlink()
    assert self_test(folder).returncode == 1


def test_command_writes_the_folder(tmp_path):
    done = run("export", "--params", HM4, "--format", "c", "--out", tmp_path / "c")
    model = hmcvt.load_model(HM4)
    assert done.code == 0
    assert done.out == f"model {model.fingerprint} written to {tmp_path / 'c'}\n"
    assert {path.name for path in (tmp_path / "c").iterdir()} == FILES
    assert [path.name for path in tmp_path.iterdir()] == ["c"]
    header = (tmp_path / "c" / "hmcvt_model.h").read_text()
    assert f"the model {model.fingerprint} of hmcvt {hmcvt.__version__}" in header


@pytest.mark.parametrize(
    "stages", [("--stage", "HM4", "--stage", "HM1"), ("--stage", "HM4", "HM1")]
)
def test_stages_keep_the_order_of_the_file(tmp_path, stages):
    options = ("--params", TRACTOR, "--format", "c", "--out", tmp_path / "c")
    done = run("export", *options, *stages, "--json")
    assert done.json["stages"] == ["HM1", "HM4"]
    source = (tmp_path / "c" / "hmcvt_model.c").read_text()
    assert 'hmcvt_stage_names[HMCVT_STAGES] = {"HM1", "HM4"}' in source


@pytest.mark.parametrize("params", [HM4, TRACTOR], ids=["one stage", "stages"])
def test_the_description_lists_every_file(tmp_path, params):
    folder = tmp_path / "c"
    hmcvt_tools.export_c(hmcvt.load_model(params), folder)
    text = (folder / "README.md").read_text(encoding="utf-8")
    written = {path.name for path in folder.iterdir()} - {"README.md"}
    text = text.replace("`math.h`", "")
    assert {file for file in written if f"`{file}`" not in text} == set()
    listed = set(re.findall(r"`([a-z_]+\.(?:c|h|csv|a2l))`", text))
    assert listed <= written
    assert "## Oil temperature" in text and "The model reads none" in text


def test_the_description_states_the_oil_temperature():
    model = hmcvt.load_model(HM4)
    assert "as warm as that of the tests" in _oil(model)
    warm = replace(model, effects=(OilTemperature(strength=1.0),))
    assert "effect oil_temperature is taken at 60 deg C" in _oil(warm)
    assert "No option of the export" in _oil(warm)


@needs_compiler
def test_odd_names_of_stages(tmp_path):
    model = hmcvt.load_model(HM4)
    stage = hmcvt.Stage(**{**vars_of(model.stage), "name": 'H"4*/\\ü?'})
    hmcvt_tools.export_c(hmcvt.EfficiencyModel(stage, model.parameters), tmp_path / "c")
    assert self_test(tmp_path / "c").returncode == 0


def vars_of(stage):
    return {name: getattr(stage, name) for name in stage.__dataclass_fields__}


def test_bad_input_is_one_line_and_writes_nothing(tmp_path):
    taken = tmp_path / "taken"
    taken.mkdir()
    file = tmp_path / "file"
    file.write_text("mine")
    base = ("export", "--params", HM4, "--format", "c", "--out")
    assert_refused(run(*base, taken), "taken: exists")
    assert_refused(run(*base, file), "file: exists")
    assert_refused(
        run(*base, tmp_path / "no" / "c"), "not a folder that can be written"
    )
    assert_refused(run(*base, tmp_path / "c", "--stage", "HM9"), "'HM9'", "HM4")
    assert_refused(run(*base, tmp_path / "c", "HM4"), "--stage")
    assert_refused(run(*base, tmp_path / "c", "--precision", "half"), "half")
    assert_refused(run(*base, tmp_path / "c", "--fmi", "2"), "--fmi")
    assert_refused(
        run("export", "--format", "fmu", "--precision", "single", "--out", "x.fmu"),
        "--precision",
    )
    assert file.read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {"taken", "file"}


def test_published_formulas_are_refused(tmp_path):
    model = hmcvt.load_model(HM4)
    published = hmcvt.EfficiencyModel(
        model.stage, model.parameters, formulation="published"
    )
    with pytest.raises(hmcvt.InputError, match="'published' is not exported"):
        hmcvt_tools.export_c(published, tmp_path / "c")
    with pytest.raises(hmcvt.InputError, match="precision"):
        hmcvt_tools.export_c(model, tmp_path / "c", "half")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_one_line(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    done = run("export", "--params", HM4, "--format", "c", "--out", tmp_path / "c")
    assert_refused(done, "c: No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_a_killed_export_leaves_nothing_under_the_name(tmp_path):
    program = """
import os, signal, sys
from pathlib import Path
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_tools.export.c_folder import _oil
from hmcvt_tools.export.folder import write_folder

class Texts(dict):
    def items(self):
        yield "a.txt", "whole"
        os.kill(os.getpid(), signal.SIGKILL)

write_folder(Path(sys.argv[1]), Texts())
"""
    target = tmp_path / "c"
    done = subprocess.run([sys.executable, "-c", program, target])
    assert done.returncode == -signal.SIGKILL
    assert not target.exists()
    write_folder(target, {"a.txt": "whole"})
    assert (target / "a.txt").read_text() == "whole"


def test_folder_is_written_whole_or_not_at_all(tmp_path):
    with pytest.raises(UnicodeEncodeError):
        write_folder(tmp_path / "c", {"a.txt": "well", "b.txt": "\ud800"})
    assert list(tmp_path.iterdir()) == []

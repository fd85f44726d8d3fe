# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The core with NumPy, SciPy and PyYAML alone, and the names that moved to `hmcvt_tools`."""

import re
import sys

import pytest
from cli.running import ROOT, TABLE2, script

import hmcvt_core as hmcvt
import hmcvt_tools

WITHOUT = """
import sys
for name in ("click", "pandas", "pint", "matplotlib", "jinja2", "openpyxl", "rclpy"):
    sys.modules[name] = None
"""
"""What an environment lacks that has the libraries of the core alone."""


def alone(code, *arguments):
    return script("-c", WITHOUT + code, *arguments, cwd=ROOT)


def test_the_core_identifies_and_diagnoses_alone():
    code = f"""
import hmcvt_core as hmcvt
samples = hmcvt.read_bench({str(TABLE2)!r})
fit = hmcvt.identify(samples)
print(hmcvt.diagnose(fit.model, samples).verdict)
hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
print(*sys.modules)
"""
    done = alone(code)
    assert (done.returncode, done.stderr) == (0, "")
    verdict, loaded = done.stdout.splitlines()
    assert verdict
    assert "hmcvt_core.diagnosis" in loaded and "hmcvt_tools" not in loaded


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("model.plot_map()", ["pictures", 'pip install ".[report]"']),
        ("samples.to_dataframe()", ["pandas", 'pip install ".[tools]"']),
    ],
)
def test_what_needs_another_library_names_it(code, words):
    done = alone(
        f"""
import hmcvt_core as hmcvt
samples = hmcvt.read_bench({str(TABLE2)!r})
model = hmcvt.load_model("params/hm4.yaml")
try:
    {code}
except hmcvt.InputError as error:
    print(error)
"""
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert all(word in done.stdout for word in words), done.stdout


@pytest.mark.parametrize("package", ["hmcvt_core", "hmcvt_tools"])
def test_the_command_without_its_libraries_is_one_line(package):
    start = f"import runpy; runpy.run_module('{package}.cli', run_name='__main__')"
    done = alone(start)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(
        r'hmcvt: error: .*click, pandas, pint: .*pip install "\.\[tools\]"\n',
        done.stderr,
    )


def test_a_unit_beyond_the_usual_ones_names_pint():
    done = alone(
        """
from hmcvt_core import InputError
from hmcvt_tools.tables.units import unit_of
print(unit_of("rpm").name)
try:
    unit_of("furlong")
except InputError as error:
    print(error)
"""
    )
    assert (done.returncode, done.stderr) == (0, "")
    first, second = done.stdout.splitlines()
    assert first == "rpm"
    assert "pint" in second and 'pip install ".[tools]"' in second


def test_the_command_by_its_former_module():
    done = script("-m", "hmcvt_core.cli", "--version", cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("hmcvt, version ")


MOVED = sorted(set(hmcvt.__all__) & set(hmcvt_tools.__all__))


def test_the_moved_names_are_listed():
    assert "estimate" in MOVED and "write_html" in MOVED
    assert set(MOVED) <= set(dir(hmcvt))


@pytest.mark.parametrize("name", MOVED)
def test_a_moved_name_is_the_same_object_with_a_warning(name):
    place = rf"hmcvt_core\.{name} has moved: import it from hmcvt_tools"
    with pytest.warns(DeprecationWarning, match=place) as caught:
        item = getattr(hmcvt, name)
    assert item is getattr(hmcvt_tools, name)
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    ("line", "place"),
    [
        ("from hmcvt_core.interface import Steadiness", "hmcvt_tools"),
        ("from hmcvt_core.mission import read_cycle", r"hmcvt_tools\.mission"),
        ("from hmcvt_core.cli.common import answers", r"hmcvt_tools\.cli\.common"),
        ("from hmcvt_core.cli import run_command", r"hmcvt_tools\.cli\.commands"),
        ("from hmcvt_core.cli import main", r"hmcvt_tools\.cli$"),
    ],
)
def test_a_former_module_forwards_with_a_warning(line, place):
    names = {}
    with pytest.warns(DeprecationWarning, match=place):
        exec(line, names)
    assert callable(names[line.rpartition(" ")[2]])


@pytest.mark.parametrize("module", ["hmcvt_core", "hmcvt_core.interface"])
def test_an_unknown_name_is_no_attribute(module):
    __import__(module)
    with pytest.raises(AttributeError, match=f"{module}.*no attribute 'nothing'"):
        _ = sys.modules[module].nothing

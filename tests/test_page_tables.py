# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Tables and code on the pages that repeat the code, or other pages."""

import math
import os
import re
import runpy
import shutil
import subprocess
import sys
import textwrap

import pytest
from cli.running import ROOT

from hmcvt_core.diagnosis import settings
from hmcvt_core.physics.effects import library


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_tables_of_the_pages_agree_with_the_code():
    tables = runpy.run_path(str(ROOT / "docs" / "code_tables.py"))
    for name, text in tables["pages"]().items():
        assert read(f"docs/{name}") == text, "run: python docs/code_tables.py"


def test_priors_of_the_page_are_those_of_the_code():
    page = read("docs/diagnosis-method.md")
    names = {
        kind.name for kind in library() if kind.__module__.startswith("hmcvt_core.")
    }
    listed = len(names - {"pressure_sensor"})  # it needs a column `pressure`
    rows = [
        ("one listed effect", settings.PRIOR_OF_SET_SIZE[1], listed),
        ("two", settings.PRIOR_OF_SET_SIZE[2], math.comb(listed, 2)),
        ("three", settings.PRIOR_OF_SET_SIZE[3], math.comb(listed, 3)),
    ]
    for words, prior, count in rows:
        (row,) = re.findall(rf"^\| {words} \| (.*) \|$", page, re.MULTILINE)
        first, rest = row.split(" | ")
        assert float(first) == prior
        number, share = re.fullmatch(r"of (\d+)\b.*: ([\d.]+)", rest).groups()
        assert int(number) == count
        assert float(share) == pytest.approx(prior / count, rel=0.05)
    for words, prior in (
        ("error of the base model alone", settings.PRIOR_BASE_DISCREPANCY),
        ("unlisted loss alone", settings.PRIOR_UNLISTED),
    ):
        (value,) = re.findall(rf"^\| {words} \| ([\d.]+) \|", page, re.MULTILINE)
        assert float(value) == prior
    combined = re.search(r"combined with a listed set \| ([\d.]+) of", page)
    assert float(combined[1]) == settings.PRIOR_UNLISTED


def test_the_form_of_the_first_change_is_an_effect():
    page = read("docs/first-change.md")
    block = re.search(
        r"( +@dataclass\(frozen=True\)\n.*?)\n\n +A class", page, re.DOTALL
    )
    code = f"""
from hmcvt_core.physics.effects import actuator
exec({textwrap.dedent(block[1])!r}, vars(actuator))
stroke = actuator.DisplacementNonlinearity(error=0.02, waves=1.0).true_displacement_ratio(0.5)
print(round(float(stroke), 3))
"""
    # In a process of its own: a class stays in the library.
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert done.stdout == "0.52\n", done.stderr


CHANNEL = """
import numpy as np
import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission
from hmcvt_tools.tables.rules import meaning_of

model = hmcvt.load_model(PARAMS)
samples = hmcvt.BenchSamples([0.5], [150.0], [200.0], [0.8], pump_torque=[40.0])
hmcvt.write_bench("bench.csv", samples)
print(hmcvt.read_bench("bench.csv").pump_torque.tolist())
print(meaning_of("pump torque [N m]").quantity)
print(*Transmission(model, samples.columns).base.names[-2:])
print(0.0 < float(model.readings_at(samples.points)["pump_torque"][0]) < 400.0)

import sys
from dataclasses import replace
sys.path.insert(0, TESTS)
from diagnosis.campaigns import BASE, campaign
from hmcvt_core.physics.effects.mechanical import ChargePump
"""


@pytest.mark.long
def test_the_channel_of_the_first_change_is_a_channel(tmp_path):
    page = read("docs/first-change.md").partition("## Add a bench channel")[2]
    entry = re.search(r"( +Quantity\(\n.*?\n {12}\),\n)", page, re.DOTALL)
    function = re.search(r"( +def pump_torque.*?)\n\n", page, re.DOTALL)
    for package in ("hmcvt_core", "hmcvt_tools"):
        shutil.copytree(ROOT / package, tmp_path / package)
    recipe = re.search(r"( +truth = .*?)\n\n", page, re.DOTALL)
    registry = tmp_path / "hmcvt_core" / "transmission" / "quantities.py"
    end = ')\n"""Every quantity of a bench."""'
    text = registry.read_text(encoding="utf-8")
    assert text.count(end) == 1
    registry.write_text(text.replace(end, entry[1] + end), encoding="utf-8")
    readings = tmp_path / "hmcvt_core" / "physics" / "readings.py"
    head, _, table = readings.read_text(encoding="utf-8").partition("READINGS: ")
    table = table.replace("\n}\n", '\n    "pump_torque": pump_torque,\n}\n')
    added = f"{head}{textwrap.dedent(function[1])}\n\nREADINGS: {table}"
    readings.write_text(added, encoding="utf-8")
    for folder in ("data", "params"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    params = str(ROOT / "params" / "hm4.yaml")
    code = CHANNEL.replace("PARAMS", repr(params))
    code = code.replace("TESTS", repr(str(ROOT / "tests")))
    done = subprocess.run(
        [sys.executable, "-c", code + textwrap.dedent(recipe[1])],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    expected = "[40.0]\npump_torque\npump_torque_gain pump_torque_zero\nTrue\n"
    expected += "ambiguous\ncause_found\n"
    assert done.stdout == expected, done.stderr


def test_summary_of_the_trials_quotes_their_pages():
    rows = re.findall(
        r"^\| .*\? \| (.*) \| (.*) \| \[.*\]\((.*)\) \|$",
        read("docs/trials.md"),
        re.MULTILINE,
    )
    assert len(rows) >= 10
    for result, goal, page in rows:
        name, _, _ = page.partition("#")
        text = read(f"docs/{name}")
        number = result.removesuffix(" points worst excess")
        assert number in text, (page, result)
        for figure in re.findall(r"[\d.]+", goal):
            assert figure in text, (page, goal)

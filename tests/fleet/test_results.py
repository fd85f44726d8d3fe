# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What `hmcvt fleet` writes and prints, and what it does when it is run again."""

import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
import yaml

import hmcvt_core as core
from hmcvt_core.physics.effects.sensor import EngineTorqueGain

from .fleets import ROOT

pytestmark = pytest.mark.slow

NAMES = [f"{number:05d}" for number in range(3)]


def test_log_gives_what_identify_and_diagnose_give(hmcvt, two_logs, alone):
    out, done = alone
    log, parameters = two_logs / "00001.csv", out / "00001.yaml"
    result = json.loads((out / "00001.json").read_text())
    identified = hmcvt("identify", log, "--json").json
    del identified["held_back"]
    assert result["identification"] == identified
    assert (
        result["diagnosis"]
        == hmcvt("diagnose", log, "--params", parameters, "--json").json
    )
    assert (result["log"], result["log_sha256"]) == (
        "00001.csv",
        core.read_bench(log).sha256,
    )
    model, entry = core.load_model(parameters), done.json["logs"][1]
    assert (entry["log"], model.provenance["data"]) == ("00001.csv", "00001.csv")
    assert model.parameters.leakage == entry["parameters"]["leakage"]["value"]


def test_finished_logs_are_skipped_and_the_table_stays(hmcvt, two_logs, alone):
    out, done = alone
    before = {path: path.stat().st_mtime_ns for path in out.glob("0*")}
    again = hmcvt("fleet", two_logs, "--out", out, "--processes", "2", "--json")
    first, second = done.json, again.json
    assert (again.code, again.err, len(before)) == (0, "", 4)
    assert (first["counts"]["finished_now"], first["counts"]["finished_before"]) == (
        2,
        0,
    )
    assert (second["counts"]["finished_now"], second["counts"]["finished_before"]) == (
        0,
        2,
    )
    assert {**first, "counts": None} == {**second, "counts": None}
    assert {path: path.stat().st_mtime_ns for path in before} == before
    text = hmcvt("fleet", two_logs, "--out", out).out
    for entry in first["logs"]:
        line = next(line for line in text.splitlines() if entry["log"] in line)
        assert f"{entry['parameters']['leakage']['value']:.3e}" in line
        assert f"{100 * entry['gap']:.2f}" in line and entry["verdict"] in line
    assert "2 logs: 0 finished now, 2 before, 0 broken; 0 outliers" in text


@pytest.fixture
def quick(hmcvt, logs, identified, tmp_path, monkeypatch):
    """Copies of logs and results, and a function that runs again and tells what was studied.

    In this process: which logs are studied does not depend on where, and a worker takes seconds.
    """
    monkeypatch.setattr("hmcvt_tools.cli.fleet.Processes", ThreadPoolExecutor)
    folder, out = tmp_path / "logs", tmp_path / "out"
    shutil.copytree(logs, folder)
    shutil.copytree(identified, out)

    def run(*options):
        before = _marks(out)
        done = hmcvt(
            "fleet", folder, "--out", out, "--no-diagnose", "--processes", "1", *options
        )
        assert done.code == 0, done
        return sorted(
            name for name, mark in _marks(out).items() if before.get(name) != mark
        )

    return folder, out, run


@pytest.fixture
def one(quick):
    """The same with one log."""
    folder, out, run = quick
    for path in (*folder.glob("*[12].csv"), *out.glob("*[12].*")):
        path.unlink()
    return folder, out, run


def _marks(out):
    return {path.stem: path.stat().st_mtime_ns for path in out.glob("*.json")}


@pytest.mark.parametrize("damage", [("{",), ("[]", "[" * 100_000), ("\udcff", "keys")])
def test_only_what_changed_is_done_again(quick, damage):
    folder, out, run = quick
    torn = damage == ("{",)
    if torn:
        (folder / "00001.csv").write_text((folder / "00000.csv").read_text())
        (out / "00000.yaml").unlink()
    for name, text in zip(NAMES[:0:-1], damage, strict=False):
        if text == "keys":  # that the table needs, by hand
            result = json.loads((out / f"{name}.json").read_text())
            text = json.dumps({**result, "identification": {}})
        (out / f"{name}.json").write_text(text, errors="surrogateescape")
    assert run() == (NAMES if torn else NAMES[1:])
    assert run() == []
    if torn:
        one, other = (
            json.loads((out / f"{name}.json").read_text()) for name in NAMES[:2]
        )
        assert one["identification"] == other["identification"]
        # Of superseded parameter files none is left.
        assert sorted(path.stem for path in out.glob("*.yaml")) == NAMES


@pytest.mark.parametrize(
    "option",
    [
        ("--seed", "1"),
        ("--transmission", "other.yaml"),
        ("--params", "based.yaml"),
        ("--formulation", "published"),
    ],
    ids=" ".join,
)
def test_changed_setting_is_done_again(one, tmp_path, option):
    _, out, run = one
    stage = yaml.safe_load((ROOT / "params" / "transmission.yaml").read_text())
    stage["pump_motor"]["pump_friction"] = 0.02
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(stage))
    base = core.load_model(ROOT / "params" / "hm4.yaml")
    core.save_model(
        replace(base, effects=(EngineTorqueGain(gain=0.002),)), tmp_path / "based.yaml"
    )
    values = [tmp_path / word if word.endswith(".yaml") else word for word in option]
    assert run(*values) == NAMES[:1]
    assert run(*values) == []
    assert json.loads((out / "00000.json").read_text())["diagnosis"] is None
    made = core.load_model(out / "00000.yaml")
    assert (made.stage.pump_motor.pump_friction == 0.02) is ("other.yaml" in option)
    assert bool(made.effects) is ("based.yaml" in option)
    assert (made.formulation == "published") is ("published" in option)
    assert made.provenance["seed"] == (1 if "--seed" in option else 0)


def test_logs_of_several_stages(hmcvt, logs, tmp_path):
    (tmp_path / "logs").mkdir()
    head, *rows = (logs / "00000.csv").read_text().splitlines()
    staged = (f"{row},{'HM4' if i % 2 else 'HM3'}" for i, row in enumerate(rows))
    (tmp_path / "logs" / "a.csv").write_text("\n".join([f"{head},stage", *staged]))
    assert (
        hmcvt(
            "fleet",
            tmp_path / "logs",
            "--out",
            tmp_path,
            "--no-diagnose",
            "--params",
            ROOT / "params" / "tractor.yaml",
        ).code
        == 0
    )
    assert list(core.load_model(tmp_path / "a.yaml").stages) == [
        "H0",
        "HM1",
        "HM2",
        "HM3",
        "HM4",
    ]


def test_edited_parameter_file_is_kept_aside(one):
    _, out, run = one
    text = (out / "00000.yaml").read_text().replace("samples: 12", "samples: 13")
    (out / "00000.yaml").write_text(text)
    assert run() == ["00000"]
    assert [path.read_text() for path in out.glob("00000.previous*.yaml")] == [text]

# SPDX-License-Identifier: Apache-2.0
"""What `hmcvt fleet` writes and prints, and what it does when it is run again."""

import json
import shutil
from dataclasses import replace

import pytest
import yaml

from hmcvt_core import load_model, read_bench, save_model
from hmcvt_core.physics.effects.sensor import EngineTorqueGain

from .fleets import ROOT, finish, fleet, results, start

NAMES = [f"{number:05d}" for number in range(4)]


def test_two_processes_give_the_digits_of_one(logs, alone, tmp_path):
    out, done = alone
    both = fleet(logs, "--out", tmp_path, "--processes", "2", "--json")
    assert both.code == 0
    assert both.out == done.out
    assert results(tmp_path) == results(out)


def test_log_gives_what_identify_and_diagnose_give(logs, alone):
    out, _ = alone
    log, parameters = logs / "00002.csv", out / "00002.yaml"
    result = json.loads((out / "00002.json").read_text())
    alone_identified = json.loads(finish(start("identify", log, "--json")).out)
    del alone_identified["held_back"]
    assert result["identification"] == alone_identified
    found = finish(start("diagnose", log, "--params", parameters, "--json"))
    assert result["diagnosis"] == json.loads(found.out)
    assert result["log"] == "00002.csv"
    assert result["log_sha256"] == read_bench(log).sha256


def test_parameter_file_is_one(alone):
    out, done = alone
    for entry in json.loads(done.out)["logs"]:
        model = load_model((out / entry["log"]).with_suffix(".yaml"))
        assert model.provenance["data"] == entry["log"]
        assert model.parameters.leakage == entry["parameters"]["leakage"]["value"]
        assert 0.5 < model.efficiency(0.5, 146.6, 200.0) < 0.95


def test_finished_logs_are_skipped_and_the_table_stays(logs, alone):
    out, done = alone
    before = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    again = fleet(logs, "--out", out, "--processes", "2", "--json")
    first, second = json.loads(done.out), json.loads(again.out)
    assert (again.code, again.err) == (0, "")
    assert (first["counts"]["finished_now"], first["counts"]["finished_before"]) == (4, 0)
    assert (second["counts"]["finished_now"], second["counts"]["finished_before"]) == (0, 4)
    assert {**first, "counts": None} == {**second, "counts": None}
    lock = out / ".hmcvt-fleet.lock"
    assert {path: path.stat().st_mtime_ns for path in out.iterdir() if path != lock} \
        == {path: time for path, time in before.items() if path != lock}


def test_table(logs, alone):
    out, done = alone
    text = fleet(logs, "--out", out).out
    for entry in json.loads(done.out)["logs"]:
        line = next(line for line in text.splitlines() if entry["log"] in line)
        assert f"{entry['parameters']['leakage']['value']:.3e}" in line
        assert f"{100 * entry['gap']:.2f}" in line and entry["verdict"] in line
    assert "4 logs: 0 finished now, 4 before, 0 broken; 0 outliers" in text


@pytest.fixture
def quick(logs, identified, tmp_path):
    """Copies of logs and results, and a function that runs again and tells what was studied."""
    folder, out = tmp_path / "logs", tmp_path / "out"
    shutil.copytree(logs, folder)
    shutil.copytree(identified[0], out)

    def run(*options):
        before = _marks(out)
        done = fleet(folder, "--out", out, "--no-diagnose", "--processes", "2", *options)
        assert done.code == 0, done
        return sorted(name for name, mark in _marks(out).items() if before.get(name) != mark)

    return folder, out, run


def _marks(out):
    return {path.stem: path.stat().st_mtime_ns for path in out.glob("*.json")}


def test_only_what_changed_is_done_again(quick):
    folder, out, run = quick
    (folder / "00001.csv").write_text((folder / "00000.csv").read_text())
    (out / "00002.yaml").unlink()
    (out / "00003.json").write_text('{"schema": "hmcvt-fleet-result/1"')  # torn
    assert run() == ["00001", "00002", "00003"]
    assert run() == []
    one, other = (json.loads((out / f"{name}.json").read_text()) for name in NAMES[:2])
    assert one["identification"] == other["identification"]
    # Of superseded parameter files none is left.
    assert sorted(path.name for path in out.glob("*.yaml")) == [f"{name}.yaml" for name in NAMES]


@pytest.mark.parametrize("option", [
    ("--seed", "1"), ("--transmission", "other.yaml"), ("--params", "based.yaml")], ids=" ".join)
def test_changed_setting_is_done_again(quick, tmp_path, option):
    _, out, run = quick
    stage = yaml.safe_load((ROOT / "params" / "transmission.yaml").read_text())
    stage["pump_motor"]["pump_friction"] = 0.02
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(stage))
    base = load_model(ROOT / "params" / "hm4.yaml")
    save_model(replace(base, effects=(EngineTorqueGain(gain=0.002),)), tmp_path / "based.yaml")
    values = [tmp_path / word if word.endswith(".yaml") else word for word in option]
    assert run(*values) == NAMES
    assert run(*values) == []
    assert json.loads((out / "00000.json").read_text())["diagnosis"] is None
    made = load_model(out / "00000.yaml")
    assert (made.stage.pump_motor.pump_friction == 0.02) is ("other.yaml" in option)
    assert bool(made.effects) is ("based.yaml" in option)
    assert made.provenance["seed"] == (1 if "--seed" in option else 0)


def test_best_gear_efficiency_is_kept(quick):
    _, out, run = quick
    found = {}
    for gears in ("0.95", "0.98", "0.95,0.98"):
        run("--gear-efficiency", gears)
        found[gears] = json.loads((out / "00000.json").read_text())["identification"]
    assert found["0.95"]["gear_efficiency"] == [0.95]
    assert found["0.95,0.98"] == min((found["0.95"], found["0.98"]),
                                     key=lambda item: item["objective"]["value"])


def test_published_formulas(logs, tmp_path):
    (tmp_path / "logs").mkdir()
    shutil.copy(logs / "00000.csv", tmp_path / "logs")
    done = fleet(tmp_path / "logs", "--out", tmp_path / "out", "--no-diagnose",
                 "--formulation", "published")
    assert done.code == 0
    assert load_model(tmp_path / "out" / "00000.yaml").formulation == "published"


def test_edited_parameter_file_is_kept_aside(quick):
    _, out, run = quick
    text = (out / "00000.yaml").read_text().replace("samples: 20", "samples: 21")
    (out / "00000.yaml").write_text(text)
    assert run() == ["00000"]
    assert [path.read_text() for path in out.glob("00000.previous*.yaml")] == [text]

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt identify`: the paper's split, what it prints and what it writes."""

import dataclasses
import pathlib

import numpy as np
import pytest
import yaml

import hmcvt_core as hmcvt_library
from hmcvt_core.physics.effects.mechanical import Churning

from .running import HM4, ROOT, TABLE2, assert_refused, process

SIMULATED = str(ROOT / "data" / "simulated.csv")
SPLIT = ("--fit", "1,2,4-6")
NOT_DETERMINED = "motor_damping is not determined by these samples"


def test_paper_split(hmcvt):
    """By the paper's formulas; by the balance: below."""
    value = hmcvt(
        "identify",
        TABLE2,
        *SPLIT,
        "--formulation",
        "published",
        "--gear-efficiency",
        "0.98",
        "--json",
    ).json
    assert value["fit_error"] <= 0.0135 and value["prediction_error"] <= 0.0170
    assert value["annealing_objective"] > value["objective"]["value"] > 0.0
    assert value["formulation"] == "published" and value["gear_efficiency"] == [0.98]
    assert [entry["sample"] for entry in value["held_back"]] == [3, 7, 8]
    mean = sum(abs(entry["error"]) for entry in value["held_back"]) / 3
    assert mean == pytest.approx(value["prediction_error"], rel=1e-5)
    assert any(NOT_DETERMINED in warning for warning in value["warnings"])


def test_file_and_report_say_what_json_says(tmp_path, hmcvt):
    """The command that params/README.md gives, as a process."""
    out = tmp_path / "hm4.yaml"
    done = process(
        "identify", "data/table2.csv", "--fit", "1,2,4,5,6", "--out", out, "--json"
    )
    assert (done.code, done.err) == (0, "")
    assert done.out[0] == "{" and done.out.endswith("}\n")
    assert done.json["fit_error"] <= 0.0205 and done.json["prediction_error"] <= 0.0165
    assert not any(NOT_DETERMINED in warning for warning in done.json["warnings"])
    model = hmcvt_library.load_model(out)
    for name, entry in done.json["parameters"].items():
        assert getattr(model.parameters, name) == entry["value"]
        assert model.standard_errors[name] == entry["standard_error"]
    text = hmcvt("identify", TABLE2, *SPLIT).out
    assert f"{100 * done.json['fit_error']:.2f} %" in text
    lines = text.split("held out:\n")[1].splitlines()[1:]
    assert [line.split()[0] for line in lines] == ["3", "7", "8"]
    for line, entry in zip(lines, done.json["held_back"], strict=True):
        assert f"{entry['predicted']:.4f}" in line


def test_part_of_the_samples_is_held_back_at_random(hmcvt):
    value = hmcvt("identify", SIMULATED, "--hold-back", "0.3", "--json").json
    held = [entry["sample"] for entry in value["held_back"]]
    assert (value["samples"], len(held)) == (67, 29)
    assert held == sorted(set(held)) and held != list(range(held[0], held[0] + 29))
    assert hmcvt("identify", SIMULATED, "--hold-back", "0.3", "--json").json == value
    other = hmcvt(
        "identify", SIMULATED, "--hold-back", "0.3", "--seed", "1", "--json"
    ).json
    assert [entry["sample"] for entry in other["held_back"]] != held
    few = hmcvt("identify", TABLE2, "--hold-back", "0.01", "--json").json
    assert few["samples"] == 7


def test_samples_held_back_where_none_was_fitted_are_told(hmcvt, tmp_path):
    rows = pathlib.Path(SIMULATED).read_text().splitlines()
    rows[1:] = sorted(rows[1:], key=lambda row: float(row.split(",")[2]))
    (tmp_path / "sorted.csv").write_text("\n".join(rows) + "\n")
    told = hmcvt("identify", tmp_path / "sorted.csv", "--fit", "1-64").out
    assert "32 of 32 samples held out lie outside the range of those fitted" in told
    assert "outside the range" not in hmcvt("identify", SIMULATED, "--fit", "1-64").out


def test_gear_efficiencies_are_compared(hmcvt, tmp_path):
    out = tmp_path / "best.yaml"
    asked = (
        "identify",
        TABLE2,
        *SPLIT,
        "--out",
        out,
        "--gear-efficiency",
        "1,0.98",
        "--gear-efficiency",
        "0.96",
    )
    lines = hmcvt(*asked).out.splitlines()
    assert lines[0].split()[:2] == ["gear", "efficiency"]
    assert [line.split()[0] for line in lines[1:4]] == ["1", "0.98", "0.96"]
    value = hmcvt(*asked, "--json").json
    assert [each["gear_efficiency"] for each in value["tried"]] == [
        [1.0],
        [0.98],
        [0.96],
    ]
    objectives = [each["objective"]["value"] for each in value["tried"]]
    assert value["best"] == value["tried"][objectives.index(min(objectives))]
    assert (
        hmcvt_library.load_model(out).stage.gear_pairs[0].efficiency
        == value["best"]["gear_efficiency"][0]
    )


def test_other_transmission(hmcvt, tmp_path):
    text = (HM4.parent / "transmission.yaml").read_text()
    made = tmp_path / "made-up.yaml"
    made.write_text(text.replace("HM4:", "LOW:").replace("11: 0.823", "11: 0.9"))
    value = hmcvt(
        "identify", TABLE2, "--transmission", made, "--stage", "LOW", "--json"
    ).json
    assert value["stage"] == "LOW"
    shipped = hmcvt("identify", TABLE2, "--json").json
    assert shipped["samples"] == 8
    assert shipped["prediction_error"] is None and shipped["held_back"] == []
    assert value["parameters"] != shipped["parameters"]


def test_all_stages_of_a_transmission(hmcvt, tmp_path):
    tractor = yaml.safe_load((HM4.parent / "tractor.yaml").read_text())
    train = {"schema": "hmcvt-transmission/1", "name": "tractor"}
    made = tmp_path / "stages.yaml"
    made.write_text(yaml.safe_dump({**train, **tractor["transmission"]}))
    model = hmcvt_library.load_model(HM4.parent / "tractor.yaml")
    points = hmcvt_library.read_bench(SIMULATED).select(range(24))
    bench = tmp_path / "bench.csv"
    for names in (["HM4"], ["HM3", "HM4"]):
        stage = np.resize(names, len(points))
        efficiency = model.efficiency(*points.points[:3], stage=stage)
        samples = dataclasses.replace(
            points, efficiency=efficiency, output_speed=None, extra={"stage": stage}
        )
        hmcvt_library.write_bench(bench, samples)
        fit = hmcvt("identify", bench, "--transmission", made, "--json").json
        # Stages of the samples, not the first one of the file.
        assert fit["stage"] == names[0] and list(fit["stages"]) == names
    errors = fit["stages"]["HM3"]["standard_errors"]
    assert errors["leakage"] > fit["parameters"]["leakage"]["standard_error"]
    assert "stages HM3, HM4: fitted to 24 samples" in (
        hmcvt("identify", bench, "--transmission", made).out
    )
    assert_refused(
        hmcvt("identify", bench, "--transmission", made, "--stage", "HM9"), "HM9", "HM4"
    )


@pytest.mark.parametrize("formulation", ["power_balance", "published"])
def test_the_effects_of_a_parameter_file_are_kept_or_named(
    hmcvt, tmp_path, formulation
):
    effects = (Churning(torque=5.0),)
    model = dataclasses.replace(hmcvt_library.load_model(HM4), effects=effects)
    params, out = tmp_path / "better.yaml", tmp_path / "out.yaml"
    hmcvt_library.save_model(model, params)
    done = hmcvt(
        *("identify", TABLE2, *SPLIT, "--params", params, "--out", out),
        *("--formulation", formulation),
    )
    assert done.code == 0, done
    kept = hmcvt_library.load_model(out).effects
    if formulation == "power_balance":
        assert kept == effects and "left out" not in done.err
    else:
        assert kept == () and "churning left out" in done.err

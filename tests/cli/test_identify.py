# SPDX-License-Identifier: Apache-2.0
"""`hmcvt identify`: the paper's split, what it prints and what it writes."""

import pytest

import hmcvt_core as hmcvt_library

from .running import HM4, TABLE2, process

SPLIT = ("--fit", "1,2,4-6")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """The command that params/README.md gives, and the file it writes."""
    out = tmp_path_factory.mktemp("params") / "hm4.yaml"
    done = process("identify", "data/table2.csv", "--fit", "1,2,4,5,6", "--out", out, "--json")
    assert (done.code, done.err) == (0, "")
    return done.json, out


@pytest.mark.parametrize(("formulation", "fit", "prediction"), [
    ("power_balance", 0.0205, 0.0165), ("published", 0.0135, 0.0170)])
def test_paper_split(formulation, fit, prediction):
    done = process("identify", "data/table2.csv", *SPLIT, "--formulation", formulation,
                   "--gear-efficiency", "0.98", "--json")
    assert (done.code, done.err) == (0, "")
    value = done.json
    assert value["fit_error"] <= fit
    assert value["prediction_error"] <= prediction
    assert value["formulation"] == formulation and value["gear_efficiency"] == [0.98]
    assert [entry["sample"] for entry in value["held_back"]] == [3, 7, 8]
    mean = sum(abs(entry["error"]) for entry in value["held_back"]) / 3
    assert mean == pytest.approx(value["prediction_error"], rel=1e-5)


def test_undetermined_parameter_is_named():
    done = process("identify", "data/table2.csv", *SPLIT, "--formulation", "published")
    assert done.code == 0
    assert "note: motor_damping is not determined by these samples" in done.out
    assert "1.32 %" in done.out and "1.62 %" in done.out


def test_shipped_file_is_what_the_command_writes(fitted):
    _, out = fitted
    made, shipped = hmcvt_library.load_model(out), hmcvt_library.load_model(HM4)
    assert made.parameters.to_array() == pytest.approx(shipped.parameters.to_array(), rel=1e-3)
    assert made.stage == shipped.stage and made.domain == shipped.domain
    assert made.formulation == shipped.formulation == "power_balance"
    assert set(made.provenance) == set(shipped.provenance)
    for name, value in made.provenance.items():
        if name != "date":
            expected = pytest.approx(value, rel=1e-4) if isinstance(value, float) else value
            assert shipped.provenance[name] == expected, name


def test_file_holds_what_json_says(fitted):
    value, out = fitted
    model = hmcvt_library.load_model(out)
    for name, entry in value["parameters"].items():
        assert getattr(model.parameters, name) == entry["value"]
        assert model.standard_errors[name] == entry["standard_error"]


def test_report_shows_fitted_and_held_back_samples(hmcvt, fitted):
    value, _ = fitted
    text = hmcvt("identify", TABLE2, *SPLIT).out
    assert f"{100 * value['fit_error']:.2f} %" in text
    _, held = text.split("held back:\n")
    lines = held.splitlines()[1:]
    assert [line.split()[0] for line in lines] == ["3", "7", "8"]
    for line, entry in zip(lines, value["held_back"], strict=True):
        assert f"{entry['predicted']:.4f}" in line


def test_all_samples_without_fit(hmcvt):
    value = hmcvt("identify", TABLE2, "--json").json
    assert value["samples"] == 8
    assert value["prediction_error"] is None and value["held_back"] == []


def test_gear_efficiencies_are_compared(hmcvt, tmp_path):
    out = tmp_path / "best.yaml"
    asked = ("identify", TABLE2, *SPLIT, "--formulation", "published", "--out", out,
             "--gear-efficiency", "1,0.98", "--gear-efficiency", "0.96")
    lines = hmcvt(*asked).out.splitlines()
    assert lines[0].split()[:2] == ["gear", "efficiency"]
    assert [line.split()[0] for line in lines[1:4]] == ["1", "0.98", "0.96"]
    value = hmcvt(*asked, "--json").json
    assert [each["gear_efficiency"] for each in value["tried"]] == [[1.0], [0.98], [0.96]]
    # Table 3 has its best there too.
    assert value["best"] == value["tried"][1]
    assert value["best"]["objective"]["value"] == min(
        each["objective"]["value"] for each in value["tried"])
    assert hmcvt_library.load_model(out).stage.gear_pairs[0].efficiency == 0.98


def test_same_seed_same_fit(hmcvt):
    first, second = (hmcvt("identify", TABLE2, *SPLIT, "--seed", "7", "--json").json
                     for _ in range(2))
    assert first == second and first["seed"] == 7


def test_other_transmission(hmcvt, tmp_path):
    text = (HM4.parent / "transmission.yaml").read_text()
    made = tmp_path / "made-up.yaml"
    made.write_text(text.replace("HM4:", "LOW:").replace("11: 0.823", "11: 0.9"))
    value = hmcvt("identify", TABLE2, "--transmission", made, "--stage", "LOW", "--json").json
    assert value["stage"] == "LOW"
    shipped = hmcvt("identify", TABLE2, "--json").json
    assert value["parameters"] != shipped["parameters"]

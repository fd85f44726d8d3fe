# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The benchmark: answer files, the scorer on cases made by hand, generator and methods."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml
from cli.running import ROOT

from studies.benchmark import rig
from studies.benchmark.answer import Answer, read_answer, write_answer
from studies.benchmark.case import Case, effects, write_columns
from studies.benchmark.generator import names_of, write_case
from studies.benchmark.methods import METHODS, forward_bic, hmcvt_diagnosis
from studies.benchmark.methods.linear import linear
from studies.benchmark.page import page
from studies.benchmark.scorer import FAILURES, f1, figures_table, scores_of, split

POINTS = 4
TRUE_GAP = np.array([0.0, 0.0, 0.02, -0.02])
ANSWER = Answer(
    case="made",
    method="mine",
    verdict="listed",
    sets=((("charge_pump",), 0.7), (("churning",), 0.1)),
    no_gap_probability=0.1,
    unlisted_probability=0.1,
    part="pump",
    promised=0.9,
    gap=(0.0, 0.0, 0.02, -0.01),
    gap_deviation=(0.001, 0.001, 0.001, 0.001),
    prediction=(0.8, 0.8, 0.82, 0.79),
)


@pytest.fixture
def made(tmp_path):
    """Return a folder with one case made by hand, and its truth."""
    own = tmp_path / "cases" / "made"
    own.mkdir(parents=True)
    card = {"classes": {"engine torque": ["charge_pump", "bearing_drag"]}}
    (own / "card.yaml").write_text(yaml.safe_dump(card), encoding="utf-8")
    base = {"channel": ["efficiency"] * POINTS, "row": [0.0, 1.0, 2.0, 3.0]}
    same = [0.8] * POINTS
    table = {**base, "base": same, "linear": same, "nuisance:leakage": same}
    table["churning:with the oil/exponent=1.5"] = same
    write_columns(own / "model_points.csv", table)
    (tmp_path / "truth").mkdir()
    write_columns(tmp_path / "truth" / "made.csv", {"efficiency": 0.8 + TRUE_GAP})
    truth = {
        "kind": "single",
        "verdict": "listed",
        "effects": ["charge_pump"],
        "classes": ["engine torque"],
    }
    (tmp_path / "truth" / "made.yaml").write_text(yaml.safe_dump(truth))
    return tmp_path


def scored(folder, answer):
    write_answer(folder / "answers" / "mine" / "made.json", answer)
    (found,) = scores_of(folder, "mine")
    return found


def test_a_right_answer(made):
    found = scored(made, ANSWER)
    assert found.exact and found.same_class and found.part and not found.worse
    # Squared error 1 of 8 parts of 1e-4.
    assert found.removed == pytest.approx(1.0 - 1.0 / 8.0)
    # 0.1^2 + 0.1^2 + (0.7 - 1)^2 + 0.1^2
    assert found.brier == pytest.approx(0.12)
    # rms of the reported gap is 0.0112: the third point alone is above it, of the true two.
    assert found.f1 == pytest.approx(2.0 / 3.0)
    assert found.coverage == 0.75


def test_a_member_of_the_class_is_right_but_not_exact(made):
    found = scored(made, replace(ANSWER, sets=((("bearing_drag",), 0.7),)))
    assert found.same_class and not found.exact


@pytest.mark.parametrize(
    "change",
    [
        {"sets": ((("churning",), 0.7),)},
        {"sets": ((("charge_pump", "churning"), 0.7),)},
        {"verdict": "unlisted"},
        {"verdict": "no_gap"},
    ],
)
def test_another_set_or_verdict_is_wrong(made, change):
    found = scored(made, replace(ANSWER, **change))
    assert not found.exact and not found.same_class


def test_a_prediction_worse_than_the_base_is_counted(made):
    found = scored(made, replace(ANSWER, prediction=(0.7, 0.8, 0.8, 0.8)))
    assert found.worse and found.removed < 0.0


def test_tests_and_points_at_which_the_base_stalls_do_not_count(made):
    own = made / "cases" / "made"
    gap = [0.01, 0.02, 0.03, 0.0]
    at = {"channel": ["efficiency"] * POINTS, "row": [0.0, 1.0, 2.0, 3.0]}
    columns = {"nuisance:leakage": gap, "churning": [0.01] * POINTS}
    stalled = [0.8, 0.8, 0.8, float("nan")]
    write_columns(
        own / "model_tests.csv", {**at, "base": stalled, "linear": stalled, **columns}
    )
    never = [0.8, 0.8, 0.8, 0.0]
    write_columns(
        own / "model_points.csv", {**at, "base": never, "linear": never, **columns}
    )
    write_columns(own / "bench.csv", {"efficiency": [0.81, 0.82, 0.83, 0.7]})
    card = {"meters": {"engine_zero": 0.0}, "classes": {}, "tests": POINTS}
    (own / "card.yaml").write_text(yaml.safe_dump(card), encoding="utf-8")
    problem = linear(Case(own))
    assert np.all(np.isfinite(problem.signatures))
    assert problem.residual[3] == 0.0 and problem.residual[0] > 0.0
    # The last point has an error of 0.1, and is left out.
    found = scored(made, replace(ANSWER, prediction=(0.8, 0.8, 0.82, 0.68)))
    assert found.removed == 1.0


def one_set(names):
    return [{"effects": names, "probability": 0.7}]


def test_f1_of_the_places():
    assert f1(TRUE_GAP, TRUE_GAP) == 1.0
    assert f1(np.zeros(4), TRUE_GAP) == 0.0
    assert f1(np.array([0.02, 0.02, 0.0, 0.0]), TRUE_GAP) == 0.0


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format", "other/1", "format = 'other/1'"),
        ("case", "other", "case = 'other', must be \"made\""),
        ("method", "other", "method = 'other', must be \"mine\""),
        ("part", "pmup", "part = 'pmup', must be .* \"pump\""),
        ("part", ["pump"], r"part = \['pump'\]"),
        ("verdict", "perhaps", "verdict = 'perhaps'"),
        ("sets", [], "sets is empty"),
        (
            "sets",
            [{"effects": ["churning"], "probability": 2}],
            r"sets\[1\].probability",
        ),
        ("sets", {"churning": 0.7}, "sets = .* must be a list"),
        ("sets", one_set("churning"), r"sets\[1\].effects = 'churning'"),
        ("sets", one_set(5), r"sets\[1\].effects = 5, must be a list"),
        ("sets", one_set(["chruning"]), r"sets\[1\] names 'chruning'"),
        ("sets", one_set(["churning:with oil"]), "names 'churning:with oil'"),
        ("sets", one_set(["churning/exponent=1.5"]), "names .* without shape"),
        ("unlisted_probability", 0.9, "sum to 1.8"),
        ("unlisted_probability", float("nan"), "unlisted_probability = nan"),
        ("promised", float("-inf"), "promised = -inf"),
        ("seconds", "fast", "seconds = 'fast', must be a finite number"),
        ("seconds", float("nan"), "seconds = nan"),
        ("no_gap_probability", None, "no_gap_probability = None"),
        ("gap", 5, "gap holds int, must be a list"),
        ("gap", [0.0], "gap has 1 values, must have 4"),
        ("gap_deviation", [0.0, 0.0, -1.0, 0.0], r"gap_deviation\[3\] = -1.0"),
        ("prediction", [0.8, 0.8, float("nan"), 0.8], r"prediction\[3\] = nan"),
    ],
)
def test_a_wrong_answer_file_is_named(made, field, value, message):
    path = made / "mine" / "made.json"
    write_answer(path, ANSWER)
    data = json.loads(path.read_text())
    data[field] = value
    path.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=message) as raised:
        read_answer(path, Case(made / "cases" / "made"))
    assert str(raised.value).startswith(f"{path}: ")


@pytest.mark.parametrize("field", ["part", "promised", "seconds", "method"])
def test_a_missing_field_is_named(made, field):
    path = made / "mine" / "made.json"
    write_answer(path, ANSWER)
    data = json.loads(path.read_text())
    del data[field]
    path.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=f"made.json: has no {field}$"):
        read_answer(path, Case(made / "cases" / "made"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON"),
        ("verdict: listed", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("[]", "holds list"),
    ],
)
def test_a_file_that_is_no_answer_is_named(made, text, message):
    path = made / "made.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"made.json: {message}"):
        read_answer(path, Case(made / "cases" / "made"))


def test_an_answer_file_comes_back_as_it_was(made):
    with_form = replace(ANSWER, sets=((("churning:with the oil",), 0.7),))
    for given in (ANSWER, with_form):
        write_answer(made / "mine" / "made.json", given)
        case = Case(made / "cases" / "made")
        assert read_answer(made / "mine" / "made.json", case) == given


def test_the_scorer_needs_nothing_of_hmcvt(made):
    write_answer(made / "answers" / "mine" / "made.json", ANSWER)
    code = (
        "import sys; from studies.benchmark import scorer; scorer.main();"
        "assert not [m for m in sys.modules if m.startswith('hmcvt')]"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(made), "mine"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert "| one cause: exact | 1 of 1 |" in run.stdout


def test_a_missing_answer_is_named(made):
    (made / "answers" / "mine").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"mine.made\.json: is missing.* 1 of 1"):
        scores_of(made, "mine")


def test_a_wrong_name_of_a_method_or_folder_is_named(made):
    write_answer(made / "answers" / "mine" / "made.json", ANSWER)
    (made / "answers" / "notes.txt").touch()
    with pytest.raises(ValueError, match=r"mien: is no folder; .* answers of mine$"):
        scores_of(made, "mien")
    with pytest.raises(ValueError, match="truth: has no cases"):
        scores_of(made / "answers", "mine")


def test_measured_cases_are_scored_apart(made):
    one = scored(made, ANSWER)
    measured = replace(one, case="rig-sound0")
    assert split({"mine": [one, measured]}) == ({"mine": [one]}, {"mine": [measured]})


def test_a_page_without_answers_of_hmcvt_says_so(made):
    write_answer(made / "answers" / "mine" / "made.json", ANSWER)
    with pytest.raises(ValueError, match="hmcvt: is no folder"):
        page(made, "the command", 96_500_000)


def test_the_page_lists_where_a_baseline_is_better(made):
    write_answer(
        made / "answers" / "hmcvt" / "made.json", replace(ANSWER, method="hmcvt")
    )
    better = replace(ANSWER, method="LASSO", prediction=(0.8, 0.8, 0.82, 0.78))
    write_answer(made / "answers" / "LASSO" / "made.json", better)
    written = page(made, "the command", 96_500_000)
    assert "kept apart from development" in written
    line = "**listed: fraction of the squared gap removed, median**: LASSO 1.00; hmcvt 0.87."
    assert line in written
    assert "**one cause: exact**" not in written
    assert written.index("## Failures") < written.index("## What is right")


@pytest.mark.long
@pytest.mark.slow
def test_a_case_of_the_twin_is_written_and_answered(tmp_path):
    """Seed 96100010: an error of the displacement, which every method should see."""
    names = names_of(12)
    name, kind, number = names[10]
    seed = 96_100_000 + number
    for copy in ("one", "two"):
        folder = tmp_path / copy
        write_case(folder / "cases", folder / "truth", name, kind, seed)
    for path in (tmp_path / "one").rglob("*"):
        other = tmp_path / "two" / path.relative_to(tmp_path / "one")
        assert path.is_dir() or path.read_bytes() == other.read_bytes(), path
    case = Case(tmp_path / "one" / "cases" / name)
    truth = yaml.safe_load((tmp_path / "one" / "truth" / f"{name}.yaml").read_text())
    assert truth["effects"] == ["displacement_error"]
    assert set(truth["effects"]) <= set(effects())
    # What is hidden is in no file of the case but among the columns of all effects.
    hidden = [p for p in case.folder.iterdir() if "displacement_error" in p.read_text()]
    assert {path.name for path in hidden} == {"model_tests.csv", "model_points.csv"}
    for method in (forward_bic, hmcvt_diagnosis):
        given = replace(method.answer(case), method="m")
        write_answer(tmp_path / "one" / "answers" / "m" / f"{name}.json", given)
        (found,) = scores_of(tmp_path / "one", "m")
        assert found.exact, method
        assert found.removed > 0.7


@pytest.mark.long
@pytest.mark.slow
def test_every_baseline_answers(tmp_path):
    pytest.importorskip("sklearn")
    name, kind, number = names_of(12)[10]
    write_case(tmp_path / "cases", tmp_path / "truth", name, kind, 96_100_000 + number)
    case = Case(tmp_path / "cases" / name)
    scores = {}
    for method, module in METHODS.items():
        if method == "hmcvt":
            continue
        __import__(f"studies.benchmark.methods.{module}")
        given = sys.modules[f"studies.benchmark.methods.{module}"].answer(case)
        given = replace(given, method=method)
        write_answer(tmp_path / "answers" / method / f"{name}.json", given)
        scores[method] = scores_of(tmp_path, method)
        assert scores[method][0].removed > 0.5, method
    assert len(figures_table(scores, FAILURES).splitlines()) == 2 + len(FAILURES)


def test_a_measured_case_has_a_baseline_and_is_answered(tmp_path):
    name = "rig-leak1-cooler100"
    assert name in rig.rig_names() and len(rig.rig_names()) == 8
    rig.write_rig_case(tmp_path / "cases", tmp_path / "truth", name)
    case = Case(tmp_path / "cases" / name)
    displacement = case.card["machine"]["displacement"]
    samples = rig.samples_of(case.tests, displacement)
    np.testing.assert_allclose(
        rig.efficiency_of(samples), case.tests["efficiency"], rtol=1e-12
    )
    assert (case.folder / "baseline.csv").is_file()
    assert case.card["licence"].startswith("CC BY 4.0")
    for method, module in (("hmcvt", hmcvt_diagnosis), ("bic", forward_bic)):
        path = tmp_path / "answers" / method / f"{name}.json"
        write_answer(path, replace(module.answer(case), method=method))
        (found,) = scores_of(tmp_path, method)
        assert found.same_class and found.part
        assert found.removed > 0.9

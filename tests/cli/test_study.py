# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt study`: what it refuses; tests/end_to_end runs all of it."""

import datetime

import pytest
from diagnosis.campaigns import diagnosed

from hmcvt_tools.report.study import StudyFile, StudyStep, study_page
from studies.gearbox import box

from .running import TABLE2, assert_refused


@pytest.fixture
def gears(hmcvt, tmp_path):
    path = tmp_path / "gears.yaml"
    assert hmcvt("transmission", "new", path, *box.DESCRIPTION).code == 0
    return path


def test_a_folder_that_holds_something_is_kept(hmcvt, gears, tmp_path):
    refused = hmcvt("study", TABLE2, gears, "--out", tmp_path)
    assert_refused(refused, "exists and is not empty")
    assert [path.name for path in tmp_path.iterdir()] == ["gears.yaml"]


def test_a_table_that_leaves_a_question_open_names_the_import(hmcvt, gears, tmp_path):
    table = tmp_path / "raw.csv"
    table.write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
    refused = hmcvt("study", table, gears, "--out", tmp_path / "out")
    assert refused.code == 2 and len(refused.err.splitlines()) == 1
    assert "raw.csv" in refused.err
    assert not (tmp_path / "out" / "index.html").exists()


def test_wrong_signs_are_refused_with_the_option(hmcvt, gears, tmp_path):
    lines = [
        "displacement_ratio,engine_speed,load_torque,efficiency,output_speed,stage"
    ]
    for stroke in (-0.9, -0.7, -0.5, -0.3, 0.0):
        speed = abs(150.0 * box.speed_ratio("R", stroke))
        lines.append(f"{stroke},150,60,0.7,{speed},R")
    bench = tmp_path / "bench.csv"
    bench.write_text("\n".join(lines) + "\n", encoding="utf-8")
    refused = hmcvt("study", bench, gears, "--out", tmp_path / "out")
    assert_refused(refused, "output_speed in stage R", "--correct-signs does so here")


def test_a_step_without_a_result_is_no_section_of_the_page():
    file = StudyFile("model.yaml", "the model")
    steps = [StudyStep("Model", (), (file,)), StudyStep("Code", ())]
    page = study_page("box", diagnosed("nothing"), steps, datetime.date(2026, 5, 1))
    assert "1. Model" in page and "Code" not in page

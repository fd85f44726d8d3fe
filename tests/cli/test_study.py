# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt study`: what it refuses and writes; `make test-long` holds it to a known machine."""

import datetime
import re

import pytest
from diagnosis.campaigns import diagnosed

from hmcvt_tools import study as study_module
from hmcvt_tools.export.effect_tables import BoundError
from hmcvt_tools.report.study import StudyFile, StudyStep, study_page
from studies.gearbox import box

from .running import TABLE2, assert_refused, run


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


def write_table(path, rows):
    """Write the table of a bench as CSV with its own headings."""
    lines = [";".join(rows[0])]
    for row in rows:
        lines.append(";".join(map(str, row.values())))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def year(tmp_path_factory, coarse_maps):
    """Return the folder of a study with a baseline of the same days, and what the command said.

    A row of the table is broken, and the tables of the effects do not keep the bound.
    """
    place = tmp_path_factory.mktemp("year")
    gears = place / "gears.yaml"
    assert run("transmission", "new", gears, *box.DESCRIPTION).code == 0
    machine = box.Machine()
    for name, seed in (("sound", 1), ("later", 2)):
        rows = [row for row in box.campaign(machine, 20, seed) if row["Gang"] == "F3"]
        for row in rows:  # one axis less for the maps
            del row["Öltemperatur [°C]"]
        if name == "later":
            rows[4]["Motormoment [Nm]"] = "defekt"
        write_table(place / f"{name}.csv", rows)

    def refused(*_, **__):
        raise BoundError("F3", 0.002, 0.014)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_module, "c_model", refused)
        done = run(
            *("study", place / "later.csv", gears, "--averaged", "--skip-bad"),
            *("--noise", "0.25%", "--baseline", place / "sound.csv"),
            *("--out", place / "out"),
        )
    assert done.code == 0, done.err
    return place / "out", done


def page_of(folder):
    return (folder / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_progress_is_a_line_a_step(year):
    steps = [line for line in year[1].err.splitlines() if line.startswith("study: ")]
    assert len(steps) == len(set(steps)) >= 7
    assert "study: diagnosis, step 2 of 3, refits with sets of effects" in steps


@pytest.mark.slow
def test_a_refused_export_is_one_line_with_the_command(year):
    folder, done = year
    (line,) = [line for line in done.err.splitlines() if "not written" in line]
    command = f"hmcvt export --params {folder / 'diagnosed.yaml'} --format c"
    assert command in line and "--bound 0.014" in line
    assert "within 0.2 points" in line
    assert command in page_of(folder)
    for name in ("report.pdf", "report.html", "model.yaml"):
        assert (folder / name).exists()


@pytest.mark.slow
def test_the_page_links_every_file(year):
    links = set(re.findall(r'href="([^"]+)"', page_of(year[0])))
    assert {"model.yaml", "diagnosed.yaml", "report.html", "report.pdf"} <= links
    for link in links:
        assert (year[0] / link).exists(), link


@pytest.mark.slow
def test_files_are_called_as_the_user_gave_them(year):
    folder, done = year
    said = " ".join(done.out.split())
    assert "sound samples of" in said and "sound.csv" in said
    for name in ("diagnosis.txt", "report.html", "diagnosis.json"):
        text = (folder / name).read_text(encoding="utf-8")
        assert "baseline.csv" not in text and "sound.csv" in text
    assert "later.csv" in (folder / "report.html").read_text(encoding="utf-8")
    assert "data: sound.csv" in (folder / "model.yaml").read_text(encoding="utf-8")


@pytest.mark.slow
def test_rows_left_out_and_shared_days_and_the_noise_are_named(year):
    folder, done = year
    (warning,) = [line for line in done.err.splitlines() if "warning: " in line]
    assert "tests of the same days (2026-03-09" in warning
    for name in ("index.html", "report.html", "diagnosis.json", "diagnosis.txt"):
        text = " ".join((folder / name).read_text(encoding="utf-8").split())
        assert re.search(r"[Ll]eft out of later.csv: row 6: ", text), name
        assert "tests of the same days" in text
        assert "not 0.25 points by --noise" in text


@pytest.mark.slow
def test_the_same_file_twice_is_refused_before_the_work(year, hmcvt, gears, tmp_path):
    bench = year[0] / "bench.csv"
    refused = hmcvt("study", bench, gears, "--baseline", bench, "--out", tmp_path / "o")
    assert_refused(refused, "every test is in the baseline")


def test_a_bound_out_of_range_is_refused_before_the_work(hmcvt, gears, tmp_path):
    out = tmp_path / "out"
    refused = hmcvt("study", TABLE2, gears, "--out", out, "--bound", "50%")
    assert_refused(refused, "bound")
    assert not out.exists()


def test_a_step_without_a_result_is_no_section_of_the_page():
    file = StudyFile("model.yaml", "the model")
    steps = [StudyStep("Model", (), (file,)), StudyStep("Code", ())]
    page = study_page("box", diagnosed("nothing"), steps, datetime.date(2026, 5, 1))
    assert "1. Model" in page and "Code" not in page

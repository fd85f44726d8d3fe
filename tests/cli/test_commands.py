# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Each command prints what the core computes, as text and as JSON, and notes beside it."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hmcvt_core as hmcvt_library
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_core.physics.effects.mechanical import FanDrive, ViscousBearingDrag
from hmcvt_core.transmission.ranges import RPM
from studies.watch import stream, well_known

from .running import HM4, POINT, ROOT, TABLE2, assert_refused

HERE = (0.5, 1400 * RPM, 200.0)


@pytest.fixture(scope="module")
def model():
    return hmcvt_library.load_model(HM4)


def test_predict_point(hmcvt, model):
    found = model.predict(*HERE)
    done = hmcvt("predict", *POINT)
    assert (done.code, done.err) == (0, "")
    assert f"{found.efficiency:.4f} +- {found.standard_error:.4f}" in done.out
    assert f"{model.output_speed(*HERE):.2f} rad/s" in done.out
    assert "outside" not in done.out
    value = hmcvt("predict", *POINT, "--json").json
    assert value == {
        "efficiency": pytest.approx(found.efficiency),
        "refusal": None,
        "inside_domain": True,
        "standard_error": pytest.approx(found.standard_error),
        "interval_90": pytest.approx(model.interval(*HERE)),
        "output_speed": pytest.approx(model.output_speed(*HERE)),
    }


def test_predict_with_a_model_that_carries_no_errors(hmcvt):
    paper = ("--params", ROOT / "params" / "paper.yaml")
    done = hmcvt("predict", *POINT, *paper)
    assert "nan" not in done.out
    assert (
        "standard error unknown" in done.out and "does not say what range" in done.out
    )
    value = hmcvt("predict", *POINT, *paper, "--json").json
    assert value["standard_error"] is None and value["inside_domain"] is None
    assert 0.0 < value["efficiency"] < 1.0


def test_predict_where_the_load_cannot_be_carried(hmcvt):
    stalled = (*POINT, "--load-torque", "5000")
    done = hmcvt("predict", *stalled)
    assert done.code == 0 and done.out.startswith("no efficiency: ")
    assert "outside the range of the data" in done.out
    value = hmcvt("predict", *stalled, "--json").json
    assert value["efficiency"] is None and value["output_speed"] is None
    assert "cannot be carried" in value["refusal"]


def test_predict_file(hmcvt, model):
    samples = hmcvt_library.read_bench(TABLE2)
    found = model.predict(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque
    )
    records = hmcvt("predict", TABLE2, "--json").json
    assert [entry["sample"] for entry in records] == list(range(1, 9))
    for i, entry in enumerate(records):
        assert entry["measured"] == samples.efficiency[i]
        assert entry["predicted"] == pytest.approx(found.efficiency[i])
        assert entry["standard_error"] == pytest.approx(found.standard_error[i])
        assert entry["inside_domain"] == found.inside_domain[i]
        assert entry["error"] == pytest.approx(
            entry["predicted"] / entry["measured"] - 1.0
        )
    lines = hmcvt("predict", TABLE2).out.splitlines()
    assert len(lines) == 11
    for line, entry in zip(lines[1:], records, strict=False):
        assert (
            f"{entry['predicted']:.4f}" in line
            and f"{100 * entry['error']:+.2f} %" in line
        )
        assert line.endswith("inside" if entry["inside_domain"] else "outside")
    mean = np.mean([abs(entry["error"]) for entry in records])
    assert lines[-2] == f"mean |error|  {100 * mean:.2f} %"
    assert lines[-1].startswith("the model was identified from 5 of these samples")


def test_predict_file_with_samples_that_have_no_answer(hmcvt, tmp_path):
    bench = tmp_path / "bench.csv"
    bench.write_text(
        "displacement_ratio,engine_speed,load_torque,efficiency\n1,30,5000,0.5\n"
    )
    done = hmcvt("predict", bench)
    assert done.code == 0 and "nan" not in done.out
    assert "no answer at 1 of 1 samples" in done.out and "mean |error|" not in done.out
    # These are new to the model.
    assert "identified from" not in done.out
    assert hmcvt("predict", bench, "--json").json[0]["predicted"] is None


def test_optimum_at_held_engine_speed(hmcvt, model):
    best = model.optimal_displacement_ratio(*HERE[1:])
    done = hmcvt("optimum", *POINT[2:])
    assert (
        f"{best.displacement_ratio:+.4f}" in done.out
        and f"{best.efficiency:.4f}" in done.out
    )
    value = hmcvt("optimum", *POINT[2:], "--json").json
    assert value["displacement_ratio"] == pytest.approx(best.displacement_ratio)
    assert value["hold"] == "engine_speed"
    assert value["limit"] is None and value["efficiency_now"] is None


def test_optimum_at_held_output_speed(hmcvt, model):
    value = hmcvt("optimum", *POINT, "--hold", "output_speed", "--json").json
    assert value["output_speed"] == pytest.approx(model.output_speed(*HERE))
    assert value["load_torque"] * value["engine_speed"] == pytest.approx(
        HERE[1] * HERE[2]
    )
    assert value["efficiency_now"] == pytest.approx(model.efficiency(*HERE))
    assert value["efficiency"] > value["efficiency_now"]
    text = hmcvt("optimum", *POINT, "--hold", "output_speed").out
    assert f"{value['efficiency']:.4f} (now {value['efficiency_now']:.4f})" in text


def test_optimum_says_which_limit_binds(hmcvt):
    held = (
        "optimum",
        *POINT[2:],
        "--hold",
        "output_speed",
        "--output-speed",
        "1900rpm",
    )
    high = hmcvt(*held, "--json").json["engine_speed"] - 5.0
    limits = ("--engine-speed-limits", "80", str(high))
    value = hmcvt(*held, *limits, "--json").json
    assert value["limit"] == "engine_speed high"
    assert value["engine_speed"] == pytest.approx(high, rel=1e-4)
    assert "limited by          engine_speed high" in hmcvt(*held, *limits).out


def test_breakdown_adds_up(hmcvt):
    value = hmcvt("breakdown", *POINT, "--json").json
    assert sum(value["losses"].values()) == pytest.approx(
        value["input_power"] - value["output_power"], rel=1e-9
    )
    assert value["efficiency"] == pytest.approx(
        value["output_power"] / value["input_power"]
    )
    rows = [line.split() for line in hmcvt("breakdown", *POINT).out.splitlines()[1:]]
    watts = [int(row[-2]) for row in rows]
    assert watts[0] - watts[-1] == pytest.approx(sum(watts[1:-1]), abs=len(watts))
    assert watts[1:-1] == sorted(watts[1:-1], reverse=True)
    assert {row[0] for row in rows[1:-1]} == set(value["losses"])


def test_map_as_csv(hmcvt, model):
    steps = ("--steps", "3", "2", "2")
    rows = list(csv.DictReader(io.StringIO(hmcvt("map", *steps).out)))
    assert len(rows) == 12
    for row in rows:
        value = model.efficiency(
            *(
                float(row[name])
                for name in ("displacement_ratio", "engine_speed", "load_torque")
            )
        )
        assert float(row["efficiency"]) == pytest.approx(value, abs=1e-5)
    assert {row["engine_speed"] for row in rows} == {"78.5398", "230.383"}
    value = hmcvt("map", *steps, "--json").json
    assert np.array(value["efficiency"]).shape == (3, 2, 2)
    assert np.ravel(value["efficiency"]) == pytest.approx(
        [float(row["efficiency"]) for row in rows], abs=1e-6
    )


def test_optimum_says_that_the_point_now_lies_outside_the_data(hmcvt):
    told = hmcvt("optimum", "--engine-speed", "1400.2rpm", "--load-torque", "200").out
    assert "  engine_speed 146.628601 rad/s is not in 78.54 to 146.61 rad/s" in told
    held = (
        "optimum",
        "--engine-speed",
        "1450rpm",
        "--load-torque",
        "200",
        "--displacement-ratio",
        "-0.8",
        "--hold",
        "output_speed",
    )
    told = hmcvt(*held).out.splitlines()
    assert told[-2].startswith("now outside the range of the data")
    assert told[-1].startswith("  engine_speed 151.8 rad/s is not in ")


def test_map_tells_where_the_data_reach(hmcvt, model):
    limits = (
        "map",
        "--steps",
        "2",
        "3",
        "3",
        "--engine-speed-limits",
        "100",
        "200",
        "--load-torque-limits",
        "100",
        "300",
    )
    value = hmcvt(*limits, "--json").json
    # From 78.54 to 146.61 rad/s and from 101.86 to 292.85 N m: 100 of 100, 150, 200 and 200 of
    # 100, 200, 300.
    inside = np.zeros((2, 3, 3), dtype=bool)
    inside[:, 0, 1] = True
    assert np.array(value["inside_domain"]).tolist() == inside.tolist()
    column = [line.split(",")[4] for line in hmcvt(*limits).out.splitlines()]
    assert column == ["inside_domain", *(str(each).lower() for each in inside.ravel())]
    stalled = (
        "map",
        "--steps",
        "2",
        "1",
        "1",
        "--load-torque-limits",
        "5000",
        "5000",
        "--engine-speed-limits",
        "80",
        "80",
    )
    assert [line.split(",")[3] for line in hmcvt(*stalled).out.splitlines()[1:]] == [
        "",
        "",
    ]
    assert hmcvt(*stalled, "--json").json["efficiency"] == [[[None]], [[None]]]


@pytest.mark.parametrize("command", ["predict", "optimum", "breakdown"])
def test_a_point_outside_the_data_is_told_with_its_axis(hmcvt, command):
    inside, outside = POINT[2:], ("--engine-speed", "2000rpm", "--load-torque", "400")
    if command != "optimum":
        inside, outside = POINT, (*POINT[:2], *outside)
    assert "range of the data" not in hmcvt(command, *inside).out
    assert hmcvt(command, *inside, "--json").json["inside_domain"] is True
    told = hmcvt(command, *outside).out.splitlines()[-3:]
    assert told == [
        "outside the range of the data that the model was identified from:",
        "  engine_speed 209.4 rad/s is not in 78.54 to 146.6 rad/s (750 to 1400 r/min)",
        "  load_torque 400 N m is not in 101.9 to 292.9 N m",
    ]
    assert hmcvt(command, *outside, "--json").json["inside_domain"] is False
    unknown = (command, *inside, "--params", ROOT / "params" / "paper.yaml")
    assert "does not say what range of data" in hmcvt(*unknown).out
    assert hmcvt(*unknown, "--json").json["inside_domain"] is None


def test_watch(hmcvt, tmp_path):
    bench, params = tmp_path / "samples.csv", tmp_path / "p.yaml"
    hmcvt_library.save_model(well_known(), params)
    hmcvt_library.write_bench(bench, stream(well_known(), 1, "charge_pump", 0.02))
    asked = ("watch", bench, "--params", params, "--noise", "0.004")
    done, found = hmcvt(*asked), hmcvt(*asked, "--json")
    assert (done.code, done.err, found.code) == (4, "", 4)
    assert done.out.startswith("a gap has opened: the bench reads ")
    assert (
        "points below the model (95 %: " in done.out and "noticed at sample" in done.out
    )
    assert found.json["open"] and found.json["since_stamp"] is None
    assert (
        found.json["interval"][0] < found.json["size"] < found.json["interval"][1] < 0.0
    )
    done = hmcvt("watch", TABLE2)
    assert done.code == 0 and done.out.startswith("no gap has opened in 8 samples")
    assert_refused(hmcvt("watch", TABLE2, "--false-alarms", "0"), "--false-alarms")


# Others: above, test_messy_tables.py, tests/fleet, tests/bag.
WRITES = {
    "identify": (TABLE2, "--fit", "1,2,4-6", "--out", "p.yaml", "--picture", "fit.png"),
    "map": (
        "--steps",
        "3",
        "3",
        "2",
        "--out",
        "m.csv",
        "--picture",
        "m.svg",
        "--bench",
        TABLE2,
    ),
    "breakdown": (*POINT, "--picture", "losses.svg"),
    "diagnose": (TABLE2, "--report", "report.pdf", "--save-model", "d.yaml"),
    "next": (TABLE2, "--noise", "0.05", "--limits", TABLE2),
    "separable": (TABLE2, "--output-speed", "--pressure"),
}


@pytest.mark.usefixtures("coarse_maps")
@pytest.mark.parametrize("name", WRITES)
def test_json_is_one_value_alone_whatever_else_is_written(
    hmcvt, tmp_path, monkeypatch, name
):
    monkeypatch.chdir(tmp_path)
    done = hmcvt(name, *WRITES[name], "--json")
    assert done.code == 0 and done.json
    assert all(line.startswith("note: ") for line in done.err.splitlines())
    named = [
        word
        for option, word in zip(WRITES[name], WRITES[name][1:], strict=False)
        if option in ("--out", "--picture", "--report", "--save-model")
    ]
    assert all((tmp_path / name).stat().st_size > 0 for name in named)


# --- copies, stalls, oil temperature, errors of meters --------------------------------------------

HEADER = "displacement_ratio,engine_speed,load_torque,efficiency\n"


def test_held_back_sample_that_stalls_is_counted(hmcvt, tmp_path):
    bench, out = tmp_path / "bench.csv", tmp_path / "model.yaml"
    rows = "".join(
        ",".join(line.split(",")[1:5]) + "\n"
        for line in Path(TABLE2).read_text().splitlines()[1:]
    )
    bench.write_text(f"{HEADER}{rows}-1,20,2000,0.3\n")
    done = hmcvt("identify", bench, "--fit", "1,2,4-6", "--out", out)
    assert "no answer at 1 of 4 samples held out" in done.out and "nan" not in done.out
    assert ".nan" not in out.read_text()
    stated = hmcvt_library.load_model(out).provenance
    assert (stated["validation_samples"], stated["validation_without_answer"]) == (4, 1)
    # The mean is that of the paper's three.
    assert stated["prediction_error"] == pytest.approx(0.0160, abs=1e-4)


def test_copied_rows_are_told(hmcvt, tmp_path):
    text, bench = Path(TABLE2).read_text(), tmp_path / "copied.csv"
    bench.write_text(text + "".join(text.splitlines(keepends=True)[1:]))
    assert "8 of 16 samples copy another one" in hmcvt("identify", bench).out
    assert "copy" not in hmcvt("identify", TABLE2).out
    bench.write_text(HEADER + 12 * "0.5,150,200,0.8\n")
    assert (
        "12 samples at 1 working point cannot determine 3"
        in hmcvt("identify", bench).out
    )


@pytest.mark.parametrize("command", ["predict", "breakdown"])
def test_oil_temperature_without_effect_is_told(hmcvt, command):
    done = hmcvt(command, *POINT, "--oil-temperature", "20", "--json")
    assert done.code == 0 and done.json["efficiency"] > 0.0
    assert done.err == (
        "note: this model has no effect of the oil temperature; --oil-temperature "
        "changes nothing\n"
    )
    assert hmcvt(command, *POINT).err == ""


@pytest.mark.parametrize(
    "command",
    [
        ("predict", *POINT),
        ("breakdown", *POINT),
        ("optimum", *POINT[2:]),
        ("map", "--steps", "2", "2", "2"),
    ],
    ids=lambda command: command[0],
)
def test_oil_temperature_that_is_assumed_is_told(hmcvt, model, tmp_path, command):
    warm = tmp_path / "warm.yaml"
    hmcvt_library.save_model(replace(model, effects=(OilTemperature(1.0),)), warm)
    assert "60 deg C" in hmcvt(*command, "--params", warm).err
    if command[0] in ("predict", "breakdown"):
        assert hmcvt(*command, "--params", warm, "--oil-temperature", "40").err == ""


@pytest.mark.parametrize(
    "command",
    [("predict", *POINT), ("predict", TABLE2), ("breakdown", *POINT)],
    ids=["point", "file", "breakdown"],
)
def test_only_a_fan_is_off_without_an_oil_temperature(hmcvt, model, tmp_path, command):
    path = tmp_path / "drags.yaml"
    effects = (ViscousBearingDrag(torque=5.0), FanDrive(torque=5.0))
    hmcvt_library.save_model(replace(model, effects=effects), path)
    assert hmcvt(*command, "--params", path).err == (
        "note: without an oil temperature, effect bearing_drag is taken at 60 deg C, "
        "effect fan_drive is off\n"
    )


def test_a_file_with_the_oil_temperature_needs_no_note(hmcvt, model, tmp_path):
    path = tmp_path / "drags.yaml"
    bench = tmp_path / "bench.csv"
    changed = replace(model, effects=(ViscousBearingDrag(torque=5.0),))
    hmcvt_library.save_model(changed, path)
    bench.write_text(f"{HEADER.strip()},oil_temperature\n0.5,150,200,0.8,70\n")
    assert hmcvt("predict", bench, "--params", path).err == ""


def test_a_page_states_the_oil_temperature_that_is_assumed(hmcvt, model, tmp_path):
    path = tmp_path / "drags.yaml"
    changed = replace(model, effects=(ViscousBearingDrag(torque=5.0),))
    hmcvt_library.save_model(changed, path)
    page = tmp_path / "page.html"
    done = hmcvt("page", path, "--out", page, "--bound", "5%")
    assert "effect bearing_drag is taken at 60 deg C" in done.err
    assert "fan_drive is off" in page.read_text(encoding="utf-8")


def test_spaced_and_inverse_units_of_speed(hmcvt):
    rest = ("--displacement-ratio", "0.5", "--load-torque", "200", "--json")
    reference = hmcvt("predict", "--engine-speed", "1400rpm", *rest).json
    for text in ("1400 1/min", "1400 rpm", "1400 r/min"):
        assert hmcvt("predict", "--engine-speed", text, *rest).json == reference


@pytest.mark.long
def test_the_saved_model_carries_what_is_unexplained(hmcvt, tmp_path):
    model = well_known()
    params = tmp_path / "p.yaml"
    hmcvt_library.save_model(model, params)
    samples = hmcvt_library.read_bench(hmcvt_library.data_path("data/simulated.csv"))
    points = samples.points
    wave = 0.02 * np.sin(3.0 * points.displacement_ratio)
    wave = wave * np.cos((points.engine_speed - 80.0) / 50.0)
    efficiency = model.readings_at(points)["efficiency"] - wave
    keep = np.isfinite(efficiency)
    noise = 0.001 * np.random.default_rng(0).standard_normal(int(keep.sum()))
    path = tmp_path / "bench.csv"
    rows = np.stack([*points[:3], efficiency], axis=1)[keep]
    rows[:, 3] += noise
    rows = rows[::2]
    head = "displacement_ratio,engine_speed,load_torque,efficiency"
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    command = ("diagnose", path, "--params", params, "--noise", "0.001", "--json")
    done = hmcvt(*command, "--save-model", tmp_path / "with.yaml")
    assert done.json["verdict"] == "unexplained"
    delivered = done.json["delivered"]
    assert delivered["rmse_after"] < 0.5 * delivered["rmse_before"]
    assert delivered["kind"] == "average" and delivered["bumps"] > 0
    assert "empirical_loss" in (tmp_path / "with.yaml").read_text()
    hmcvt(*command, "--no-empirical", "--save-model", tmp_path / "without.yaml")
    assert "empirical_loss" not in (tmp_path / "without.yaml").read_text()

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What users measure, with units, and the best working point of the drive line."""

import csv
import math
from itertools import product

import pytest

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import RPM
from hmcvt_tools.cli.common import torque

from .running import ENGINE, TRACTOR, assert_refused

WHOLE = hmcvt.load_model(TRACTOR)
HM3 = WHOLE.stages["HM3"]
STAGE = ("--params", TRACTOR, "--stage", "HM3")
SPEED = 1800 * RPM


@pytest.mark.parametrize(("stroke", "load"), [(0.725, -150), (-0.6, 60), (0.2, 0)])
def test_a_point_by_whatever_is_measured(hmcvt, stroke, load):
    torque = load + HM3.power_loss(stroke, SPEED, load) / SPEED
    output = HM3.output_speed(stroke, SPEED, load)
    loads = {
        "--load-torque": f"{load:.12g}N m",
        "--output-power": f"{load * SPEED / 1e3:.12g}kW",
        "--output-torque": f"{load * SPEED / abs(output):.12g}Nm",
        "--engine-torque": f"{torque / 1e3:.12g}kNm",
    }
    strokes = {
        "--displacement-ratio": f"{100 * stroke:g}%".replace(".", ","),
        "--output-speed": f"{output / RPM:.12g}r/min",
    }
    for by_load, by_stroke in product(loads.items(), strokes.items()):
        found = hmcvt(
            "predict",
            *STAGE,
            "--engine-speed",
            "1800rpm",
            *by_load,
            *by_stroke,
            "--json",
        ).json
        told = {"displacement_ratio": stroke, "load_torque": load, **found}
        assert told["displacement_ratio"] == pytest.approx(stroke, abs=1e-7)
        assert told["load_torque"] == pytest.approx(load, abs=1e-3)
        assert found["output_speed"] == pytest.approx(output, rel=1e-7)


@pytest.mark.parametrize(
    ("text", "value"),
    [("150.250", 150.25), ("1.2kNm", 1200.0), ("1,5 kN m", 1500.0), ("-50", -50.0)],
)
def test_a_point_is_never_between_thousands(text, value):
    assert torque(text) == value


def test_ground_speed(hmcvt):
    found = hmcvt(
        "predict",
        *STAGE,
        "--engine-speed",
        "1800rpm",
        "--output-power",
        "20,5kW",
        "--output-speed",
        "8km/h",
        "--tyre-radius",
        "0.9",
        "--final-drive",
        "45",
        "--json",
    ).json
    assert found["output_speed"] == pytest.approx(8 / 3.6 / 0.9 * 45)
    assert found["load_torque"] == pytest.approx(20.5e3 / SPEED)


def test_overrun_is_told(hmcvt):
    light = hmcvt(
        "predict",
        *STAGE,
        "--engine-speed",
        "1800rpm",
        "--displacement-ratio",
        "0.5",
        "--load-torque",
        "-5",
    )
    assert (
        light.code == 0
        and "no efficiency: in overrun the wheels give less" in light.out
    )
    assert f"{HM3.power_loss(0.5, SPEED, -5.0):.0f} W" in light.out
    watts = hmcvt(
        "breakdown",
        *STAGE,
        "--engine-speed",
        "1800rpm",
        "--displacement-ratio",
        "0.5",
        "--load-torque",
        "-150",
        "--json",
    ).json
    assert watts["efficiency"] == pytest.approx(
        watts["input_power"] / watts["output_power"]
    )
    assert sum(watts["losses"].values()) == pytest.approx(
        watts["input_power"] - watts["output_power"]
    )


def test_optimum_of_the_drive_line(hmcvt):
    asked = (
        "optimum",
        "--params",
        TRACTOR,
        "--output-speed",
        "120",
        "--output-power",
        "40kW",
    )
    found = hmcvt(*asked, "--engine", ENGINE, "--json").json
    assert list(found) == [
        "stage",
        "displacement_ratio",
        "engine_speed",
        "load_torque",
        "efficiency",
        "engine_torque",
        "fuel_rate",
        "limit",
        "inside_domain",
    ]
    assert found["engine_speed"] * found["load_torque"] == pytest.approx(40e3)
    text = hmcvt(*asked, "--engine", ENGINE).out
    assert f"stage               {found['stage']}" in text
    assert (
        f"{3.6e6 * found['fuel_rate']:.0f} g/h" in text and "for each watt lost" in text
    )
    alone = hmcvt(*asked, "--json").json
    assert alone["fuel_rate"] is None
    assert alone["engine_torque"] * alone["engine_speed"] <= (
        found["engine_torque"] * found["engine_speed"] * (1 + 1e-9)
    )
    by_torque = hmcvt(*asked[:-2], "--output-torque", f"{40e3 / 120}", "--json").json
    assert by_torque["engine_speed"] == pytest.approx(alone["engine_speed"], rel=1e-6)
    kept = hmcvt(
        *asked, "--engine", ENGINE, "--stage", "HM3", "--hysteresis", "90%", "--json"
    ).json
    assert kept["stage"] == "HM3" and math.isfinite(kept["fuel_rate"])


def test_map_of_the_drive_line(hmcvt, tmp_path):
    out, picture = tmp_path / "drive.csv", tmp_path / "drive.svg"
    asked = (
        "map",
        "--params",
        TRACTOR,
        "--output-speed",
        "350",
        "--engine",
        ENGINE,
        "--steps",
        "12",
        "8",
        "1",
    )
    assert hmcvt(*asked, "--out", str(out), "--picture", str(picture)).code == 0
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 96 and {row["stage"] for row in rows} >= {
        "HM1",
        "HM3",
        "HM4",
        "",
    }
    for row in rows[::7]:
        if not row["stage"]:
            assert row["fuel_rate"] == ""
            continue
        point = [
            float(row[name])
            for name in ("displacement_ratio", "engine_speed", "load_torque")
        ]
        assert WHOLE.output_speed(*point, stage=row["stage"]) == pytest.approx(
            float(row["output_speed"]), rel=1e-6
        )
        assert point[1] * point[2] == pytest.approx(float(row["output_power"]))
    assert all(
        f">{word}<" in picture.read_text(encoding="utf-8").replace("\n", "")
        for word in ("HM1", "HM4", "output power [kW]")
    )
    told = hmcvt(*asked, "--json").json
    assert [row["stage"] or "" for row in told] == [row["stage"] for row in rows]
    for wrong in (("--stage", "HM3"), ("--bench", "x.csv")):
        assert_refused(hmcvt(*asked, *wrong), "are not of the drive line")
    assert_refused(hmcvt("map", "--engine", ENGINE), "--output-speed is needed")


def test_stages_that_pass_standstill_have_a_picture(hmcvt, tmp_path):
    for stage, power in (("H0", "3kW"), ("HM1", "20kW")):
        picture = tmp_path / f"{stage}.svg"
        assert (
            hmcvt(
                "map",
                "--params",
                TRACTOR,
                "--stage",
                stage,
                "--power",
                power,
                "--picture",
                str(picture),
            ).code
            == 0
        )
        assert picture.stat().st_size > 10_000

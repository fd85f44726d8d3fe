# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Ratios in teeth, paths without a pair, and slips derived from the sides of clutches."""

import copy

import pytest
import yaml

import hmcvt_core as hmcvt
from hmcvt_core.transmission.check import check_stages
from hmcvt_core.transmission.stage import Stage, stages_from_mapping

TRACTOR = yaml.safe_load(
    hmcvt.data_path("params/tractor.yaml").read_text(encoding="utf-8")
)["transmission"]
DRIVEN_BY = {
    "H0": "motor/5/6/8/9/10",  # both of its paths reverse
    "HM1": "HM1.carrier/6/7/9/12",
    "HM2": "HM2.ring/6/7/11",
    "HM3": "HM3.carrier/6/9/12",
    "HM4": "HM4.ring/6/11",
}
"""What drives the output in each stage of the tractor."""


def two_stages():
    """Two forward stages and a reverse stage on one row, in teeth."""
    hydraulics = {
        "planetary_row": "k",
        "pump": {"gear_pairs": ["P"]},
        "motor": {"gear_pairs": ["M"], "member": "sun"},
    }
    forward = {"gear_pairs": ["A"], "member": "ring"}
    backward = {"gear_pairs": ["R"], "member": "ring", "direction": -1}
    low = {"gear_pairs": ["O"], "member": "carrier"}
    return {
        "gear_pairs": {"A": "36/45", "P": "31/40", "M": "52/26", "O": "70/28", "R": 1},
        "planetary_rows": {"k": "96/36"},
        "pump_motor": {
            "pump_displacement_cm3_per_rev": 55,
            "motor_displacement_cm3_per_rev": 55,
        },
        "stages": {
            "F1": {**hydraulics, "mechanical": forward, "output": low},
            "F2": {
                **hydraulics,
                "mechanical": forward,
                "output": {"gear_pairs": [], "member": "carrier"},
            },
            "R": {
                **hydraulics,
                "reverse": True,
                "mechanical": backward,
                "output": low,
            },
        },
        "clutches": {
            "C1": {"between": ["carrier/O", "output"], "closed": ["F1", "R"]},
            "C2": {"between": ["carrier", "output"], "closed": ["F2"]},
            "forward": {"between": ["engine/A", "ring"], "closed": ["F1", "F2"]},
            "reverse": {"between": ["-engine/R", "ring"], "closed": ["R"]},
        },
    }


def test_slips_of_the_tractor_follow_from_its_clutches():
    data = copy.deepcopy(TRACTOR)
    listed = {}
    for name, stage in data["stages"].items():
        listed[name] = stage.pop("open_clutches")
    data["clutches"] = {
        name: {"between": ["output", side], "closed": [name]}
        for name, side in DRIVEN_BY.items()
    }
    for stage in stages_from_mapping(data):
        derived = {name: list(slip) for name, *slip in stage.open_clutches}
        assert derived.keys() == listed[stage.name].keys()
        for name, slip in derived.items():
            # The slip is the same in size; the file of the tractor has four digits.
            assert slip == pytest.approx(listed[stage.name][name], abs=1e-4)


def test_teeth_and_a_path_without_a_pair():
    first, second, reverse = stages_from_mapping(two_stages())
    assert first.mechanical.ratio == pytest.approx(36 / 45)
    assert first.planetary_constant == pytest.approx(96 / 36)
    assert second.output.ratio == 1.0 and second.output.efficiency == 1.0
    assert {name: slip for name, *slip in first.open_clutches} == {
        "C2": [0.0, pytest.approx(1.5)],
        "reverse": [pytest.approx(-1.0 - 45 / 36), 0.0],
    }
    # The ring that the engine drives forward turns against the gear of reverse, and vice versa.
    assert {name: slip for name, *slip in reverse.open_clutches} == {
        "C2": [0.0, pytest.approx(1.5)],
        "forward": [pytest.approx(1.0 + 45 / 36), 0.0],
    }


def test_teeth_of_driven_and_driving_gear_may_be_named():
    data = two_stages()
    data["gear_pairs"]["A"] = {"driving": 45, "driven": 36}
    assert stages_from_mapping(data) == stages_from_mapping(two_stages())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"gear_pairs": {"A": "36/0"}},
            r"gear_pairs\.A = '36/0': 0 is no count of teeth",
        ),
        ({"gear_pairs": {"A": "3.6/4"}}, r"gear_pairs\.A .* not two whole numbers"),
        ({"gear_pairs": {"A": {"driven": 3}}}, r"gear_pairs\.A .* driven and driving"),
        ({"planetary_rows": {"k": "96/"}}, r"planetary_rows\.k .* not two whole"),
        (
            {"clutches": {"C1": {"between": ["carrier", "output"], "closed": ["F1"]}}},
            r"clutches\.C1\.closed = F1: its sides differ",
        ),
        (
            {"clutches": {"C1": {"between": ["carrier"]}}},
            r"clutches\.C1\.between .* allowed: two sides",
        ),
        (
            {"clutches": {"C1": {"between": ["planet", "output"]}}},
            "shaft 'planet' is not known; there is engine, motor",
        ),
        (
            {"clutches": {"C1": {"between": ["carrier/X", "output"]}}},
            r"gear_pairs\.X is missing",
        ),
        (
            {"clutches": {"C1": {"between": ["F9.ring", "output"]}}},
            r"stages\.F9 is missing",
        ),
        (
            {"clutches": {"C1": {"between": ["ring", "output"], "closed": ["F9"]}}},
            r"stages\.F9 is missing",
        ),
    ],
)
def test_wrong_teeth_and_clutches_are_refused_by_name(change, message):
    data = two_stages()
    for section, entries in change.items():
        data[section].update(entries)
    with pytest.raises(hmcvt.InputError, match=message):
        stages_from_mapping(data)


def test_a_clutch_is_stated_once():
    data = two_stages()
    data["stages"]["F1"]["open_clutches"] = {"C2": [0.0, 1.5]}
    with pytest.raises(hmcvt.InputError, match="C2 is in clutches of the file too"):
        Stage.from_mapping(data, "F1")


def test_a_reverse_stage_that_passes_standstill_is_no_neighbour_of_forward():
    data = two_stages()
    data["gear_pairs"]["R"] = (
        9.0  # slow enough for the motor to turn the output forward
    )
    data["clutches"] = {}
    check = check_stages(stages_from_mapping(data))
    directions = {entry.name: entry.direction for entry in check.stages}
    assert directions["R"] == "both"
    assert [(meeting.lower, meeting.upper) for meeting in check.overlaps] == [
        ("F1", "F2")
    ]
    (remark,) = [text for text in check.remarks if text.startswith("R drives")]
    assert "backward, but forward next to stroke +1" in remark


def test_derived_slips_survive_saving(tmp_path):
    stages = stages_from_mapping(two_stages())
    model = hmcvt.EfficiencyModel(
        stages[0],
        hmcvt.HydraulicParameters(3e-11, 0.2, 0.1),
        other_stages=stages[1:],
    )
    hmcvt.save_model(model, tmp_path / "model.yaml")
    again = hmcvt.load_model(tmp_path / "model.yaml")
    assert again.stages["R"].stage.open_clutches == stages[2].open_clutches

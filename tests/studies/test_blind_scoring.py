# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The score of a blind trial names what the rate over all effects hides."""

from studies.blind.conditions import REFERENCE
from studies.blind.scoring import report


def campaign(truth, first, *, left=50.0, probability=0.9):
    return {"condition": REFERENCE, "truth": [truth] if truth else [], "known": True, "left": left,
            "verdict": "cause_found" if first else "no_gap", "promised": 0.9, "met": 0.9,
            "place_found": False,
            "causes": [{"effect": first, "probability": probability, "set": [first]}] if first
            else []}


def test_effects_below_the_goal_are_named():
    records = [
        *(campaign("charge_pump", "charge_pump") for _ in range(18)),
        *(campaign("charge_pump", "clutch_drag") for _ in range(2)),
        *(campaign("torque_sensor", first) for first in ("torque_sensor", "charge_pump")),
        campaign("bearing_drag", "charge_pump"), campaign("churning", None, left=3.0),
        campaign(None, None),
    ]
    text = report(records, "python -m")
    assert "| right cause first | 19/23 = 83 %" in text
    assert ("Below that goal for the right cause first: bearing_drag (0 of 1), torque_sensor "
            "(1 of 2).") in text
    assert "at least 18 of it" in text


def test_nothing_is_named_where_every_effect_meets_the_goal():
    assert "Below that goal" not in report(
        [campaign("charge_pump", "charge_pump")], "python -m")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The blind trial: what it draws, and that its score counts strictly."""

import numpy as np
import pytest

from studies.blind.catalogue import KNOWN_EFFECTS
from studies.blind.conditions import DETECTABLE, IMAGE, LOOP, Case, cases, draw
from studies.blind.loop import MOST
from studies.blind.scoring import goals, report
from studies.blind.visible import beyond_others, visible


def record(truth, told, **others):
    kind = {0: "none", 1: "single", 2: "pair", 3: "triple"}[len(truth)]
    return {
        "condition": "0.4 %",
        "kind": kind,
        "group": kind,
        "seed": 1,
        "truth": truth,
        "variants": [""] * len(truth),
        "columns": [],
        "misfit": 0.0,
        "left": [50.0],
        "beyond": 30.0,
        "seconds": 1.0,
        "unlisted": 0.0,
        "verdict": "cause_found" if told else "no_gap",
        "sets": [(told, 0.9)] if told else [],
        "alternatives": [told] if told else [],
        "promised": 0.9,
        "met": 0.9,
        "told_gap": 0.01,
        "true_gap": 0.01,
        "f1": 0.7,
        "f1_everything": 0.4,
        "place_found": False,
        "correlation": 0.96,
        **others,
    }


def row(records, what):
    lines = goals(records).splitlines()
    return next(line for line in lines if line.startswith(f"| {what} |"))


def test_only_the_exact_set_that_is_named_counts_as_first():
    churning = ["churning"]
    records = [
        record(churning, churning),
        record(churning, ["churning", "compressibility"]),
        record(churning, churning, verdict="unexplained"),
        record(churning, ["gear_mesh"]),
    ]
    assert "1/4 = 25 %" in row(records, "single, not confounded: first")
    assert "**missed**" in row(records, "single, not confounded: first")
    pair = ["churning", "gear_mesh"]
    two = [
        record(pair, pair),
        record(pair, churning, sets=[(churning, 0.5), (pair, 0.4)]),
    ]
    assert "1/2 = 50 %" in row(two, "pair: exact set first")
    assert "2/2 = 100 %" in row(two, "pair: among the best three sets")


def test_what_something_else_listed_imitates_has_a_row_without_it():
    records = [
        record(["churning"], ["gear_mesh"], beyond=3.0),
        record(["churning"], ["churning"]),
    ]
    assert "1/2 = 50 %" in row(records, "single, not confounded: first")
    assert "1/1 = 100 %" in row(
        records, "single: first, where no other listed effect imitates it"
    )


def test_a_set_longer_than_three_does_not_count():
    long = ["churning", "a", "b", "c"]
    records = [
        record(["churning"], ["churning"], alternatives=[long]),
        record(["churning"], ["a"], alternatives=[["a", "churning"]]),
    ]
    assert "1/2 = 50 %" in row(records, "single: in a set of at most three")


def test_twins_do_not_count_as_first_and_a_base_that_is_off_is_no_cause():
    assert row(
        [record(["torque_sensor"], ["charge_pump"])], "single, not confounded: first"
    ).endswith("|  |")
    off = [
        record([], ["gear_mesh"], group="base off"),
        record([], [], group="base off"),
    ]
    assert "1/2 = 50 %" in row(off, "cause named, base off by 0.1 to 0.2 points")


def test_a_band_of_probability_is_judged_by_how_often_it_was_right():
    records = [record(["churning"], ["churning"], sets=[(["churning"], 0.8)])] * 3 + [
        record(["churning"], ["gear_mesh"], sets=[(["gear_mesh"], 0.8)])
    ] * 3
    assert "0.30 **missed**" in row(
        records, "probability of the first set: largest error of a band"
    )
    assert "| 0.70 to 0.90 | 0.80 | 3/6 = 50 %" in report(records, "python", "used")


def test_a_loop_that_settles_wrongly_counts_as_long_as_one_that_never_settles():
    def end(tests, right):
        return {
            "tests": tests,
            "settled": True,
            "right": right,
            "reason": "settled",
            "alive": [(["churning"] if right else ["gear_mesh"], 0.97)],
        }

    records = [
        record(
            ["churning"], [], condition=LOOP, asked=end(4, True), random=end(12, True)
        ),
        record(
            ["churning"], [], condition=LOOP, asked=end(2, False), random=end(8, True)
        ),
    ]
    text = report(records, "python", "used")
    assert f"| {(4 + MOST) / 2:.1f} | 10.0 |" in text
    assert "| wrong set settled | at most 5 % | 1/2 = 50 %" in text


@pytest.mark.parametrize(
    "kind", ["pair", "triple", "faint", "-stroke_leakage", "oil_temperature"]
)
def test_what_is_drawn_is_what_the_kind_says(kind):
    campaign = draw(Case("0.4 %", kind, 1))
    seen = visible(campaign)
    assert len(seen.left) == {"pair": 2, "triple": 3}.get(kind, 1)
    assert (min(seen.left) < DETECTABLE) == (kind == "faint")
    assert seen.alike < IMAGE
    assert "oil_temperature" in campaign.samples or kind != "oil_temperature"


def test_columns_do_not_give_the_effect_away():
    drawn = [draw(Case("0.4 %", "none", seed)) for seed in range(40)]
    share = {
        name: np.mean([name in campaign.samples for campaign in drawn])
        for name in ("oil_temperature", "output_speed")
    }
    assert 0.3 < share["oil_temperature"] < 0.7
    assert 0.75 < share["output_speed"] < 1.0
    assert not any(campaign.bench.misfit for campaign in drawn)
    assert all(draw(Case("0.4 %", "base off", seed)).bench.misfit for seed in range(3))


def test_seeds_of_a_trial_are_its_own():
    here, there = cases(0, 2), cases(500_000_000, 2)
    assert len({case.seed for case in here}) == len(here)
    assert not {case.seed for case in here} & {case.seed for case in there}
    assert {case.kind for case in here} >= {
        *KNOWN_EFFECTS,
        "pair",
        "triple",
        "base off",
        "faint",
    }


@pytest.mark.parametrize(
    ("kind", "alone"),
    [
        pytest.param("-churning", False, marks=pytest.mark.long),
        ("swash_chatter", True),
    ],
)
def test_some_strangers_look_as_a_listed_effect_does(kind, alone):
    assert (beyond_others(draw(Case("0.4 %", kind, 1))) > DETECTABLE) == alone

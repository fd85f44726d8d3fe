# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Scores of the bench: by classes, and strictly."""

import pytest
from click.testing import CliRunner

from hmcvt_core.benches.transmission import system
from hmcvt_core.errors import InputError
from studies.blind.__main__ import command
from studies.blind.bench.classes import ENGINE_TORQUE, PROPORTIONAL, classes_of
from studies.blind.bench.judge import judge
from studies.blind.bench.library import listed_name, without_effects
from studies.blind.bench.properties import PROPERTIES, Bench
from studies.blind.bench.scores import (
    band_table,
    cost_table,
    score_table,
    unlisted_table,
)
from studies.blind.bench.study import cases
from studies.blind.bench.truth import KINDS, USUAL_KINDS
from studies.blind.bench.unlisted_losses import UNLISTED_LOSSES


def record(kind, truth, leading, **others):
    return {
        "kind": kind,
        "seed": 1,
        "layout": "HM4",
        "true_classes": truth,
        "truth": truth,
        "left": [50.0],
        "beyond": 30.0 if truth else None,
        "verdict": "cause_found" if leading else "no_gap",
        "classes": [[leading, 0.8]] if leading else [],
        "unlisted": 0.0,
        "promised": 0.9,
        "interval": [0.8, 0.95],
        "met": 0.88,
        "true_gap": 0.01,
        "left_gap": 0.0035,
        "level": 0.001,
        "members": [[leading, 0.96]] if leading else [],
        "correlation": 0.97,
        "seconds": 2.0,
        **others,
    }


def row(records, what):
    lines = score_table(records).splitlines()
    return next(line for line in lines if line.startswith(f"| {what} |"))


def test_a_worse_model_of_a_small_gap_is_counted_apart():
    small = record(
        "single", ["churning"], ["churning"], true_gap=0.0015, left_gap=0.002
    )
    large = record("single", ["churning"], ["churning"])
    assert "1/2" in row([small, large], "served: not worse than the base")
    beyond = "the same, gap above twice the level of the meters"
    assert "1/1" in row([small, large], beyond)


def test_effects_that_no_test_distinguishes_are_one_class():
    forms = {"torque_sensor": "zero of the engine meter"}
    assert classes_of(["charge_pump"], {}, False) == [ENGINE_TORQUE]
    assert classes_of(["bearing_drag", "torque_sensor"], forms, False) == [
        ENGINE_TORQUE
    ]
    assert classes_of(["torque_sensor"], {"torque_sensor": "output_zero"}, False) == [
        "torque_sensor"
    ]
    assert classes_of(["gear_mesh", "planetary_mesh"], {}, True) == [PROPORTIONAL]
    assert classes_of(["gear_mesh"], {}, False) == ["gear_mesh"]
    assert classes_of(["torque_sensor"], {"torque_sensor": "engine_gain"}, True) == [
        PROPORTIONAL
    ]


def test_a_set_with_a_false_member_is_first_by_class_but_not_exact():
    records = [
        record("single", ["churning"], ["churning"]),
        record("single", ["churning"], ["churning", "compressibility"]),
        record("single", ["churning"], ["churning"], verdict="unexplained"),
        record("single", ["churning"], ["gear_mesh"], beyond=3.0),
    ]
    assert "2/4 = 50 %" in row(records, "single: class first")
    assert "2/3 = 67 %" in row(records, "single: class first")
    assert "1/4 = 25 %" in row(records, "single: exact set first")
    assert "2/4 = 50 %" in row(records, "single: a false member leads")
    assert "1/4 = 25 %" in row(records, "listed refused")


def test_alarms_and_named_causes_count_against_the_bench_without_effects():
    records = [
        record("nothing", [], []),
        record("nothing", [], [], verdict="unexplained"),
        record("base_off", [], [], verdict="unexplained"),
        record("base_off", [], ["gear_mesh"]),
    ]
    assert "1/2 = 50 %" in row(records, "alarms, exact base")
    assert "1/2 = 50 %" in row(records, "cause named, base off")


def test_promises_and_probabilities_are_compared_with_what_holds():
    records = [
        record("single", ["churning"], ["churning"]),
        record("single", ["churning"], ["churning"], met=0.7),
        record("unlisted", ["oil_fan"], ["churning"]),
    ]
    assert "1/2 = 50 %" in row(records, "interval of the promise holds")
    assert "0.11 of 2" in row(records, "promised - met: median")
    assert "| 0.70 to 0.90 | 0.80 | 2/3 = 67 %" in band_table(records)


def test_the_cost_of_a_property_is_a_line_of_figures():
    exact = record("single", ["churning"], ["churning"])
    wrong = record("single", ["churning"], ["gear_mesh"])
    text = cost_table({"nothing": [exact, wrong], "zero": [exact, exact]})
    assert "1/2 = 50 %" in text.splitlines()[2]
    assert "2/2 = 100 %" in text.splitlines()[3]


def test_every_unlisted_loss_has_a_line_with_what_is_named_instead():
    refused = record("unlisted", ["oil_fan"], [], verdict="unexplained")
    named = record("unlisted", ["oil_fan"], ["churning"], beyond=5.0)
    *_, line = unlisted_table([refused, named]).splitlines()
    assert line == "| `oil_fan` | 2 | 1 | 0 | 1 | churning (1) |"
    assert unlisted_table([record("single", ["churning"], ["churning"])]) == ""


def test_kinds_are_mixed_and_a_longer_run_begins_as_a_shorter_one():
    long = cases(42, 7, Bench())
    assert [case.key for case in cases(10, 7, Bench())] == [
        case.key for case in long[:10]
    ]
    count = {kind: sum(case.kind == kind for case in long) for kind in KINDS}
    assert all(count[kind] == 2 * KINDS[kind] for kind in USUAL_KINDS)
    assert {case.kind for case in cases(8, 7, Bench(), ("pair", "nothing"))} == {
        "pair",
        "nothing",
    }


def test_names_that_do_not_exist_are_refused():
    with pytest.raises(InputError, match="'weather' does not exist"):
        Bench().without("weather")
    with pytest.raises(InputError, match="'many' does not exist"):
        cases(3, 7, Bench(), ("many",))
    off = Bench().without(*PROPERTIES)
    assert not any(vars(off).values())


@pytest.mark.long
@pytest.mark.parametrize("name", ["temperature", "statement", "record"])
def test_a_campaign_is_judged_without_a_column(name):
    (case,) = cases(1, 5, Bench().without(name), ("nothing",))
    assert judge(case)["sessions"] >= 2


@pytest.mark.long
def test_a_run_prints_its_table_and_keeps_its_records(tmp_path):
    out = tmp_path / "records.json"
    options = "--plant bench --campaigns 1 --seed 5 --kinds nothing --jobs 1"
    page = tmp_path / "page.md"
    files = ["--out", str(out), "--page", str(page)]
    ran = CliRunner().invoke(command, [*options.split(), *files])
    assert ran.exit_code == 0, ran.output
    assert "alarms, exact base" in ran.output
    assert '"kind": "nothing"' in out.read_text()
    assert "--campaigns 1 --seed 5 --kinds nothing`" in page.read_text()


def test_an_unlisted_loss_is_left_out_of_the_list():
    loss = UNLISTED_LOSSES["creeping_clutch"]()
    with without_effects([loss]):
        names = {kind.name for kind in system.library()}
    assert names.isdisjoint(loss.listed_as)
    assert "charge_pump" in names
    assert listed_name(loss) in {None, *loss.listed_as}

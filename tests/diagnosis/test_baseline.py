# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A transmission compared with its sound state."""

import datetime
import json
import re
from dataclasses import replace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.baseline import without_absent
from hmcvt_core.benches.baseline.record import _without_gap
from hmcvt_core.benches.transmission.change import shared_test_notes
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.outcome import CauseSet
from hmcvt_core.diagnosis.selection.classes import EffectClass, merge_sets
from hmcvt_core.files.bench import joined
from hmcvt_core.physics.effects.mechanical import BearingDrag, ChargePump, Churning
from hmcvt_core.physics.effects.wear import LaminarLeakage
from hmcvt_tools.report import html
from hmcvt_tools.report.sheet import draw_sheet
from hmcvt_tools.report.study import study_page
from hmcvt_tools.report.style import styled

from .campaigns import BASE, campaign

pytestmark = pytest.mark.slow

NOISE = 0.004
SERVED = replace(BASE, parameters=hmcvt.HydraulicParameters(1e-11, 0.1, 0.1))
"""A model whose parameters are not those of the machine."""


def bench(effects=(), seed=0, n=24):
    """Tests of the machine with further effects."""
    return campaign(effects, seed, n=n, noise=NOISE)


@pytest.fixture(scope="module")
def sound():
    return bench(seed=1000, n=48)


@pytest.fixture(scope="module")
def worn(sound):
    leak = LaminarLeakage(leakage=0.5 * BASE.parameters.leakage)
    return hmcvt.diagnose(SERVED, bench((leak,)), baseline=sound, noise=NOISE)


@pytest.mark.long
def test_sessions_share_errors_of_meters_and_of_the_baseline():
    """The errors of the sound prediction join those of the meters, without names."""
    days = {"session": tuple(np.repeat(["one", "two", "three"], 16))}
    before = replace(bench(seed=1000, n=48), extra=days)
    days = {"session": tuple(np.repeat(["four", "five"], 12))}
    later = replace(bench(seed=1), extra=days)
    answer = hmcvt.diagnose(SERVED, later, baseline=before, noise=NOISE)
    assert answer.verdict == "no_gap"


def test_leakage_grown_by_half_is_named(worn):
    assert worn.verdict in ("cause_found", "ambiguous")
    assert worn.component == "pump"
    assert worn.sets[0].effects == ("laminar_leakage",)
    size = worn.causes[0].parameters["leakage"]
    low, high = size["interval"]
    assert low < 0.5 * BASE.parameters.leakage < high


def test_growth_is_stated_in_per_cent_of_the_baseline(worn):
    growth = worn.baseline.growth(worn)
    low, high = growth.interval
    assert growth.word == "leakage" and low < 0.5 < high
    assert growth.sound == worn.baseline.machine.parameters["leakage"].value
    per_cent = [f"{100.0 * value:+.0f} %" for value in (growth.part, high)]
    assert worn.second_line == (
        f"Leakage {per_cent[0]} against the sound machine (95 % interval "
        f"{100.0 * low:+.0f} to {per_cent[1]})."
    )
    warm = growth.sentence(np.array([68.0, 70.0]))
    assert "against the sound machine at 69 deg C (95 %" in warm
    assert worn.to_dict()["baseline"]["growth"]["part"] == growth.part


@pytest.fixture(scope="module")
def page(worn, coarse_maps):
    return html(worn)


@pytest.mark.usefixtures("coarse_maps")
def test_the_growth_is_the_second_line_of_every_report(worn, page):
    first, _, _ = worn.report().partition("\n\n")
    assert " ".join(first.split()) == f"{words.mechanic(worn)} {worn.second_line}"
    date = datetime.date(2026, 5, 1)
    for text in (page, study_page("box", worn, [], date)):
        texts = re.findall(r'<p class="verdict">(.*?)</p>', text)
        assert texts == [words.mechanic(worn), worn.second_line]
    texts = texts_of_sheet(worn)
    assert worn.second_line in " ".join(texts)
    # What is compared, and no other size of the leakage.
    growth = worn.baseline.growth(worn)
    assert f"now {100.0 * growth.part:+.0f} %" in " ".join(texts)
    assert not any("laminar leakage, leakage:" in text for text in texts)


def texts_of_sheet(diagnosis):
    """Return the texts of the one page of paper, line by line."""
    with styled((8.27, 11.69)) as figure:
        draw_sheet(figure, diagnosis, datetime.date(2026, 5, 1))
        return [text.get_text() for text in figure.texts]


def test_the_sheet_has_no_words_of_the_method(worn):
    text = " ".join(texts_of_sheet(worn))
    assert "deviations of the meter" not in text
    assert worn.model.fingerprint not in text
    (member, *_) = worn.members
    assert re.search(r"\d W lost on average, 95 %: \d+ to \d+ W", text)
    relative = member.lost_power_error / member.lost_power
    size = worn.causes[0].parameters["leakage"]
    # The power of one effect is proportional to its size.
    assert relative == pytest.approx(size["standard_error"] / size["value"], rel=0.2)


def test_a_growth_is_no_more_certain_than_its_cause(worn):
    doubted = replace(worn.causes[0], probability=0.5)
    doubtful = replace(worn, causes=(doubted, *worn.causes[1:]))
    line = worn.baseline._second_line(doubtful)
    assert line.startswith("If it is laminar leakage: leakage +")
    nothing = replace(worn, verdict="unexplained")
    assert worn.baseline._second_line(nothing) == ""
    assert nothing.to_dict()["baseline"]["growth"] is None


def test_an_effect_that_is_zero_within_its_error_is_not_named(worn):
    alone = worn.posterior.best_with("laminar_leakage").names
    assert alone == ("laminar_leakage",)
    first, *others = worn.sets
    worn = replace(worn, sets=(replace(first, effects=alone), *others))
    assert without_absent(worn) is worn
    leading = replace(worn.causes[0], may_be_absent=True)
    absent = without_absent(replace(worn, causes=(leading, *worn.causes[1:])))
    assert all(item.effects != alone for item in absent.sets)
    assert absent.unlisted == pytest.approx(worn.unlisted + first.probability)


def test_sound_is_no_change_and_a_load_that_it_cannot_carry_is_named(sound):
    samples = bench(seed=1)
    load = samples.load_torque.copy()
    load[3] = 5e3
    heavy = replace(samples, load_torque=load)
    answer = hmcvt.diagnose(SERVED, heavy, baseline=sound, noise=NOISE)
    assert any("1 of 24 samples ask for a load" in note for note in answer.notes)
    assert answer.verdict == "no_gap" and not answer.baseline.control.alarms


@pytest.mark.long
def test_no_gap_stands_above_no_significant_one(sound):
    """A difference within the errors of a thin baseline is no change, whatever its size."""
    churned = (Churning(torque=25.0),)
    few = bench(churned, seed=1000, n=18)
    answer = hmcvt.diagnose(SERVED, bench(churned, seed=3), baseline=few, noise=NOISE)
    assert answer.verdict == "no_gap"
    assert answer.gap.p_value > 0.02 and not answer.gap.significant
    assert answer.shrinkage.before <= answer.gap.rmse


def test_without_a_gap_the_base_is_handed_over(worn):
    assert worn.delivered.kind == "leading set"
    without = _without_gap(worn, worn.baseline.excess)
    assert without.advice.report().startswith("stop: no gap worth a test")
    assert without.delivered.kind == "base" and without.model is without.base
    np.testing.assert_array_equal(without.residuals_after, without.residuals_before)


def test_json_and_text_name_the_baseline(worn):
    data = json.loads(json.dumps(worn.to_dict()))
    baseline = data["baseline"]
    assert (baseline["source"], baseline["samples"]) == ("simulated", 48)
    assert baseline["control"]["verdict"] == "no_gap"
    assert baseline["control"]["p_value"] == pytest.approx(0.38, abs=0.01)
    assert baseline["p_value"] <= 0.02 and not baseline["thin"]
    assert "Compared with 48 sound samples" in worn.report()
    assert max(map(len, worn.report().splitlines())) <= 100


def test_next_tests_are_listed_once(worn):
    points = [(test.point, test.setting, test.measure) for test in worn.next_tests]
    assert all(point not in points[:i] for i, point in enumerate(points))


def test_page_of_a_change(page):
    assert "Compared with 48 sound samples" in page and "laminar leakage" in page


def test_model_with_the_change_is_saved(worn, tmp_path):
    path = tmp_path / "worn.yaml"
    hmcvt.save_model(worn.model, path)
    loaded = hmcvt.load_model(path)
    assert [effect.name for effect in loaded.effects] == ["laminar_leakage"]
    assert loaded.fingerprint == worn.model.fingerprint


def test_a_class_holds_the_effects_that_are_the_same_curve(worn):
    """A bearing stands for a charge pump too, and no test tells either from a meter."""
    baseline = replace(
        worn.baseline, same_curves={"bearing_drag": (BearingDrag(), ChargePump())}
    )
    meter_or_bearing = EffectClass(
        members=("torque_sensor", "bearing_drag"),
        forms=("zero of the engine meter", ""),
        components=("sensor", "gears"),
        remedies=("check the zero", "spin it"),
        component="sensor",
        probability=0.8,
        sets=(("torque_sensor",), ("bearing_drag",)),
    )
    expanded = baseline._expanded_class(meter_or_bearing)
    assert expanded.members == ("torque_sensor", "bearing_drag", "charge_pump")
    assert expanded.components == ("sensor", "gears", "pump")
    assert ("charge_pump",) in expanded.sets
    leading = CauseSet(("bearing_drag",), 0.8, None, None, (meter_or_bearing.members,))
    sets = baseline._expanded_sets((leading,))
    assert {item.alternatives for item in sets} == {(expanded.members,)}
    merged = merge_sets([(item.effects, item.probability) for item in sets], [expanded])
    assert [item.probability for item in merged] == pytest.approx([0.8])


@pytest.mark.long
def test_a_faulty_baseline_is_diagnosed_first():
    churned = (Churning(torque=25.0),)
    faulty = bench(churned, seed=1000, n=64)
    answer = hmcvt.diagnose(SERVED, bench(churned), baseline=faulty, noise=NOISE)
    assert answer.verdict == "no_gap"
    assert any("the baseline itself differs from the model" in n for n in answer.notes)


def test_wrong_baselines_are_named(sound):
    samples = bench(seed=1)
    other = replace(sound, output_speed=1.3 * np.asarray(sound.output_speed))
    with pytest.raises(hmcvt.InputError, match="of another machine"):
        hmcvt.diagnose(SERVED, samples, baseline=other, noise=NOISE)
    with pytest.raises(hmcvt.InputError, match="9 samples are too few for a baseline"):
        hmcvt.diagnose(SERVED, samples, baseline=sound.select(np.arange(9)))
    with pytest.raises(hmcvt.InputError, match="baseline"):
        hmcvt.diagnose(SERVED, samples, baseline="sound.csv")


def dated(samples, day):
    """Return samples of one day, a minute apart."""
    start = np.datetime64(day, "s").astype(float)
    return replace(samples, stamp=start + 60.0 * np.arange(len(samples)))


def test_tests_that_are_in_the_baseline_too_are_named(sound):
    with pytest.raises(hmcvt.InputError, match="every test is in the baseline"):
        hmcvt.diagnose(SERVED, sound.select(np.arange(20)), baseline=sound, noise=NOISE)
    later = joined([bench(seed=1, n=20), sound.select(np.arange(4))])
    (note,) = shared_test_notes(later, sound)
    assert note.startswith("4 of 24 tests") and "sample 21" in note


def test_days_that_both_files_share_are_named(sound):
    later = bench(seed=1)
    before = dated(sound, "2026-03-09")
    (note,) = shared_test_notes(dated(later, "2026-03-09"), before)
    assert "tests of the same days (2026-03-09)" in note
    assert shared_test_notes(dated(later, "2027-03-09"), before) == []
    # Seconds that a bench counts itself are no dates.
    relative = dated(later, "1970-01-01")
    assert shared_test_notes(relative, dated(sound, "1970-01-01")) == []


def test_noise_by_the_baseline_in_place_of_a_statement_is_named(worn, sound):
    (note,) = [note for note in worn.notes if note.startswith("the noise is")]
    assert "scatter of the baseline" in note and "not 0.4 points by --noise" in note
    assert note in worn.to_dict()["notes"]
    assert "by --noise" in " ".join(worn.report().split())

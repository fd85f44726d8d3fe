# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers and sentences that tell a diagnosis."""

from dataclasses import replace

import pytest
from cli.running import ROOT

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import NextTest, Region
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.outcome import LEADING_SET, Cause, CauseSet, Delivered
from hmcvt_core.diagnosis.statements.members import Member, condition_of
from hmcvt_core.physics.effects.hydraulic import OilTemperature
from hmcvt_tools.report.answer import members

from .campaigns import diagnosed


@pytest.mark.parametrize(
    ("said", "text"),
    [
        (words.fixed(-0.001, 2), "0.00"),
        (words.fixed(-1.25, 1, sign=True), "\N{MINUS SIGN}1.2"),
        (words.fixed(float("nan"), 2), "\N{EN DASH}"),
        (words.fixed(None, 2), "\N{EN DASH}"),
        (words.number(0.0), "0"),
        (words.number(0.0123456), "0.0123"),
        (words.number(1234.56), "1.23 \N{MULTIPLICATION SIGN} 10³"),
        (words.number(2.5e-11), "2.5 \N{MULTIPLICATION SIGN} 10⁻¹¹"),
        (words.number(1e5), "1 \N{MULTIPLICATION SIGN} 10⁵"),
        (words.number(0.001), "0.001"),
        (words.fixed(0.001, 2, sign=True), "0.00"),
        (words.fixed(0.125, 2, sign=True), "+0.12"),
        (words.percent(0.456), "46 %"),
        (words.probability(0.0), "0 %"),
        (words.probability(0.009), "< 1 %"),
        (words.probability(0.01), "1 %"),
        (words.probability(0.99), "99 %"),
        (words.probability(0.991), "> 99 %"),
        (words.chance(0.001), f"{words.AT_MOST} 0.001"),
        (words.chance(0.0123), "0.012"),
        (words.chance(None), "\N{EN DASH}"),
        (words.p_is(0.03), "p = 0.03"),
        (words.p_is(0.0005), f"p {words.AT_MOST} 0.001"),
        (words.plain("gear_mesh"), "gear mesh"),
        (words.listed(["a"]), "a"),
        (words.listed(["a", "b", "c"], "and"), "a, b and c"),
        (words.fraction_interval((0.2, 0.94)), "20 to 94 %"),
        (words.fraction_interval((-0.2, 0.94)), "below 0 to 94 %"),
        (words.fraction_interval((-2.0, -1.0)), "below 0 %"),
    ],
)
def test_numbers(said, text):
    assert said == text


def _region(speed, load=(40.0, 600.0), channel="efficiency", p_value=0.001):
    limits = {
        "displacement_ratio": (-1.0, 1.0),
        "engine_speed": speed,
        "load_torque": load,
    }
    return Region(limits, -0.012, 9, p_value, channel)


def unexplained():
    """A real diagnosis that found nothing, had it found a gap."""
    found = diagnosed("nothing")
    return replace(
        found,
        verdict="unexplained",
        where=(_region((80.0, 110.0)),),
        shrinkage=replace(found.shrinkage, before=0.012),
    )


def test_where_it_lies():
    found = unexplained()
    assert found.extent["engine_speed"] == pytest.approx((80.0, 230.0), abs=8.0)
    assert list(found.extent) == [axis.name for axis in found.axes]
    assert words.region_words(_region((80.0, 110.0)), found) == "low engine speed"
    assert words.region_words(_region((150.0, 160.0), (500.0, 600.0)), found) == (
        "medium engine speed and high load"
    )
    assert words.region_words(_region((80.0, 200.0)), found) == "", "most of the range"
    stroke = replace(
        _region((200.0, 230.0)),
        limits={
            "displacement_ratio": (-0.5, 0.25),
            "engine_speed": (200.0, 230.0),
            "load_torque": (40.0, 600.0),
        },
    )
    assert words.region_words(stroke, found) == (
        "high engine speed and displacement ratio \N{MINUS SIGN}0.50 to 0.25"
    )
    gap = words.amount(found, found.shrinkage.before)
    beyond = f"Bench and model differ by {gap} beyond the noise, "
    for region, start in (
        (
            _region((80.0, 110.0)),
            "The bench lies 1.20 points below the refitted model, mostly "
            "at low engine speed.",
        ),
        (
            _region((80.0, 230.0)),
            "The bench lies 1.20 points below the refitted model over the whole range.",
        ),
        (
            replace(_region((80.0, 110.0)), mean_residual=0.002),
            "The bench lies 0.20 points above the refitted model, mostly at low engine speed.",
        ),
        (
            _region((80.0, 110.0), channel="output_speed"),
            beyond + "most clearly in the output speed at low engine speed.",
        ),
        (
            _region((80.0, 110.0), p_value=0.2),
            beyond.removesuffix(", ") + ".",
        ),
    ):
        assert words.verdict(replace(found, where=(region,))).startswith(start)
    # The largest region need not be the significant one.
    regions = (_region((200.0, 230.0), p_value=0.2), _region((80.0, 110.0)))
    assert "at low engine speed" in words.verdict(replace(found, where=regions))


def test_agreement_is_stated_no_more_surely_than_it_is_known():
    nothing = diagnosed("nothing")
    assert words.mechanic(nothing) == "Bench and model agree: nothing to look for."
    open_question = replace(nothing, posterior=replace(nothing.posterior, no_gap=0.59))
    assert words.mechanic(open_question) == (
        "Bench and model agree with only 59 %: more tests would decide."
    )


def test_an_assumed_noise_rules_no_gap_out():
    model = hmcvt.load_model(ROOT / "params" / "hm4.yaml")
    found = hmcvt.diagnose(model, hmcvt.read_bench(ROOT / "data" / "table2.csv"))
    assert found.verdict == "no_gap"
    report = found.report()
    assert report.startswith(
        "No gap shown; 8 samples and an assumed noise cannot rule one out."
    )
    assert "\nverdict    no_gap\ngap        8 samples, " in report
    assert " rms that noise may explain, p = 0." in report
    assert "next step  State the noise, or repeat some points" in report


def test_verdicts():
    nothing, band = diagnosed("nothing"), unexplained()
    assert (
        "differs from the 48 samples by no more than their noise of 0."
        in words.verdict(nothing)
    )
    assert "No effect in the library explains it" in words.verdict(band)
    alone = Cause(
        "charge_pump", "", "pump", 0.95, (), None, {}, 0.001, 0.7, {}, "", "", "", None
    )
    one = CauseSet(("charge_pump",), 0.9, 0.001, 0.7)
    found = replace(
        band,
        verdict="cause_found",
        causes=(alone,),
        sets=(one,),
        set_is_settled=True,
        lost_power=400.0,
        delivered=Delivered(0.012, 0.005, LEADING_SET),
        shrinkage=replace(
            band.shrinkage, fraction=0.8, interval=(0.6, 0.9), on="cross-validation"
        ),
    )
    assert words.verdict(found).endswith(
        "; charge pump (90 %) explains it. On held-out samples, with charge pump added, 80 % of "
        "the squared gap is removed (60 to 90 %)."
    )
    pair = CauseSet(("charge_pump", "churning"), 0.85, 0.001, None)
    both = replace(
        found, causes=(replace(alone, together_with="churning"),), sets=(pair, one)
    )
    assert "; charge pump + churning (85 %) explain it. On held-out" in words.verdict(
        both
    )
    assert words.mechanic(both).startswith("Probably charge pump and churning, about ")
    test = NextTest({}, ("charge pump", "churning"), 0.5)
    with_test = replace(alone, remedy="measure the charge pressure")
    for tests, end in (
        ((), ": measure the charge pressure."),
        ((test,), " on average."),
    ):
        advice = replace(found.advice, tests=tests, measure=None)
        told = replace(found, advice=advice, causes=(with_test,))
        assert words.mechanic(told).endswith(end)
    doubt = replace(
        both,
        verdict="ambiguous",
        sets=tuple(
            replace(each, probability=p) for each, p in ((pair, 0.5), (one, 0.4))
        ),
    )
    assert (
        "charge pump + churning (50 %) explains it best, but these data cannot distinguish it from "
        "charge pump (40 %)."
    ) in words.verdict(doubt)
    assert words.mechanic(doubt).startswith(
        "Perhaps charge pump and churning, or others, about "
    )
    many = replace(
        doubt, sets=tuple(replace(one, probability=p) for p in (0.25, 0.2, 0.2, 0.1))
    )
    assert (
        "several sets of causes remain possible, among them charge pump (25 %), charge pump "
        "(20 %) and charge pump (20 %)."
    ) in words.verdict(many)
    for chances, told in (
        ((0.3, 0.01, 0.009), "30 %, charge pump 1 %"),
        (6 * (0.1,), ", charge pump ".join(5 * ["10 %"])),
    ):
        sets = tuple(replace(one, probability=p) for p in chances)
        assert (
            f"sets charge pump {told}, something unlisted {words.probability(band.unlisted)} "
            "causes probability over all sets"
        ) in " ".join(replace(doubt, sets=sets).report().split())
    smooth = replace(band, unlisted=0.9, misfit=0.8)
    assert words.mechanic(smooth) == (
        "The model is slightly off, smoothly: too little to blame any part."
    )
    assert "smoothly: less than a cause would need" in words.verdict(smooth)
    for fraction, end in (
        (None, "do not show how far the gap would shrink."),
        (-0.1, "the gap does not shrink yet."),
    ):
        told = replace(found, shrinkage=replace(found.shrinkage, fraction=fraction))
        assert words.verdict(told).endswith(end)


@pytest.mark.parametrize(
    ("power", "condition", "text"),
    [
        (834.0, "", "830 W lost on average"),
        (-918.0, "", "920 W less loss on average"),
        (
            -452.0,
            "oil at 60 deg C",
            "450 W less loss on average than with oil at 60 deg C",
        ),
        (
            452.0,
            "oil at 60 deg C",
            "450 W more loss on average than with oil at 60 deg C",
        ),
    ],
)
def test_power_in_words(power, condition, text):
    assert words.power_in_words(power, condition) == text


def test_a_condition_is_no_damage():
    oil = Member(
        ("oil_temperature",),
        "oil",
        0.97,
        lost_power=-452.0,
        lost_power_error=10.0,
        condition=condition_of(OilTemperature()),
    )
    cause = Cause(
        "oil_temperature",
        "",
        "oil",
        0.97,
        (),
        None,
        {},
        0.001,
        0.7,
        {},
        "",
        "",
        "",
        None,
    )
    found = replace(
        unexplained(),
        verdict="cause_found",
        causes=(cause,),
        sets=(CauseSet(("oil_temperature",), 0.9, 0.001, 0.7),),
        members=(oil,),
        set_is_settled=True,
        lost_power=-452.0,
    )
    assert words.mechanic(found).startswith(
        "Probably oil temperature, a condition and no damage, about 450 W less loss on average "
        "than with oil at 60 deg C"
    )
    (line,) = members(found)
    assert line.detail == (
        "oil, a condition and no damage, 450 W less loss on average than with oil at 60 deg C, "
        "95 %: 432 to 472 W"
    )

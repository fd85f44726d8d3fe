# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Numbers and sentences that tell a diagnosis."""

from dataclasses import replace

import pytest

from hmcvt_core.diagnosis import Region, words
from hmcvt_core.diagnosis.result import Cause

from .campaigns import diagnosed


@pytest.mark.parametrize(("said", "text"), [
    (words.fixed(-0.001, 2), "0.00"), (words.fixed(-1.25, 1, sign=True), "\N{MINUS SIGN}1.2"),
    (words.fixed(float("nan"), 2), "\N{EN DASH}"), (words.fixed(None, 2), "\N{EN DASH}"),
    (words.number(0.0), "0"), (words.number(0.0123456), "0.0123"),
    (words.number(1234.56), "1.23 \N{MULTIPLICATION SIGN} 10³"),
    (words.number(2.5e-11), "2.5 \N{MULTIPLICATION SIGN} 10⁻¹¹"), (words.number(1e5),
     "1 \N{MULTIPLICATION SIGN} 10⁵"), (words.number(0.001), "0.001"),
    (words.fixed(0.001, 2, sign=True), "0.00"), (words.fixed(0.125, 2, sign=True), "+0.12"),
    (words.percent(0.456), "46 %"),
    (words.probability(0.0), "0 %"), (words.probability(0.009), "< 1 %"),
    (words.probability(0.01), "1 %"), (words.probability(0.99), "99 %"),
    (words.probability(0.991), "> 99 %"), (words.chance(0.001), f"{words.AT_MOST} 0.001"),
    (words.chance(0.0123), "0.012"), (words.chance(None), "\N{EN DASH}"),
    (words.p_is(0.03), "p = 0.03"), (words.p_is(0.0005), f"p {words.AT_MOST} 0.001"),
    (words.plain("gear_mesh"), "gear mesh"),
    (words.listed(["a"]), "a"), (words.listed(["a", "b", "c"], "and"), "a, b and c"),
    (words.fraction_interval((0.2, 0.94)), "20 to 94 %"),
    (words.fraction_interval((-0.2, 0.94)), "below 0 to 94 %"),
    (words.fraction_interval((-2.0, -1.0)), "below 0 %"),
])
def test_numbers(said, text):
    assert said == text


def _region(speed, load=(40.0, 600.0), channel="efficiency", p_value=0.001):
    limits = {"displacement_ratio": (-1.0, 1.0), "engine_speed": speed, "load_torque": load}
    return Region(limits, -0.012, 9, p_value, channel)


def unexplained():
    """A real diagnosis that found nothing, had it found a gap."""
    found = diagnosed("nothing")
    return replace(found, verdict="unexplained", where=(_region((80.0, 110.0)),),
                   shrinkage=replace(found.shrinkage, before=0.012))


def test_where_it_lies():
    found = replace(unexplained(), extent={
        "displacement_ratio": (-1.0, 1.0), "engine_speed": (80.0, 230.0),
        "load_torque": (40.0, 600.0)})
    assert words.region_words(_region((80.0, 110.0)), found) == "low engine speed"
    assert words.region_words(_region((150.0, 160.0), (500.0, 600.0)), found) == (
        "medium engine speed and high load")
    assert words.region_words(_region((80.0, 200.0)), found) == "", "most of the range"
    stroke = replace(_region((200.0, 230.0)), limits={
        "displacement_ratio": (-0.5, 0.25), "engine_speed": (200.0, 230.0),
        "load_torque": (40.0, 600.0)})
    assert words.region_words(stroke, found) == (
        "high engine speed and displacement ratio \N{MINUS SIGN}0.50 to 0.25")
    gap = words.amount(found, found.shrinkage.before)
    beyond = f"Bench and model differ by {gap} beyond the noise, "
    for region, start in (
            (_region((80.0, 110.0)), "The bench lies 1.20 points below the refitted model, mostly "
                                     "at low engine speed."),
            (_region((80.0, 230.0)), "The bench lies 1.20 points below the refitted model over "
                                     "the whole range."),
            (replace(_region((80.0, 110.0)), mean_residual=0.002),
             "The bench lies 0.20 points above the refitted model, mostly at low engine speed."),
            (_region((80.0, 110.0), channel="output_speed"),
             beyond + "most clearly in the output speed at low engine speed."),
            (_region((80.0, 110.0), p_value=0.06), beyond + "and no single place stands out.")):
        assert words.verdict(replace(found, where=(region,))).startswith(start)


def test_verdicts():
    nothing, band = diagnosed("nothing"), unexplained()
    assert "differs from the 48 samples by no more than their noise of 0." in words.verdict(nothing)
    assert "No effect in the library explains it" in words.verdict(band)
    alone = Cause("charge_pump", "", "pump", 0.95, (), None, {}, 0.001, 0.7, {}, "", "", "", None)
    found = replace(band, verdict="cause_found", causes=(alone,), shrinkage=replace(
        band.shrinkage, fraction=0.8, interval=(0.6, 0.9), on="cross-validation"))
    name = "charge pump"
    assert words.verdict(found).endswith(
        f"; {name} (95 %) explains it. On samples left out, with the effect picked anew without "
        f"them each time, 80 % of the squared gap is removed (60 to 90 %); 70 % with {name} held "
        "as the effect.")
    pair = replace(alone, together_with="churning")
    beside = replace(alone, effect="churning", together_with=alone.effect, probability=0.6,
                     indistinguishable_from=("a_b", "c", "d", "e", "f"))
    both = replace(found, causes=(pair, beside))
    assert (f"{name} (95 %) together with churning (60 %) explain it, but these data cannot tell "
            "churning from a b, c, d or 2 others.") in words.verdict(both)
    many = replace(found, verdict="ambiguous", causes=tuple(
        replace(alone, probability=p) for p in (0.25, 0.2, 0.2, 0.1)))
    assert (f"several causes remain possible, among them {name} (25 %), {name} (20 %) and {name} "
            "(20 %).") in words.verdict(many)
    for fraction, end in ((None, "cannot be told from these samples."),
                          (-0.1, "the gap does not shrink yet.")):
        told = replace(found, shrinkage=replace(found.shrinkage, fraction=fraction))
        assert words.verdict(told).endswith(end)

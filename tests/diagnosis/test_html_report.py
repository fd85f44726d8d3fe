# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The page of a diagnosis: one real diagnosis, and what it could have been."""

import base64
import datetime
import functools
import hashlib
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, replace
from html import unescape
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import Diagnosis, NextTest, ShrinkageSummary
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.results.outcome import CauseSet, keeping_base
from hmcvt_core.diagnosis.results.stages import stages_of
from hmcvt_core.diagnosis.statements.agreement import Agreement, Look
from hmcvt_core.diagnosis.statements.members import Member
from hmcvt_core.diagnosis.statements.scatter import ExcessScatter
from hmcvt_core.physics.effects.mechanical import ChargePump
from hmcvt_tools.report import figures, gap_map, html, write_report
from hmcvt_tools.report.figures import test_labels as labels_of_tests
from hmcvt_tools.report.figures import test_rows as rows_of_tests
from hmcvt_tools.report.gap_map import (
    draw_gap,
    draw_view,
    estimate,
    held_values,
    largest_gap_map,
    lead_map,
    page_maps,
    views,
)
from hmcvt_tools.report.residuals import stage_rows
from hmcvt_tools.report.sheet import draw_sheet

from .campaigns import BASE, NOISE, campaign, diagnosed
from .html_browser import Layout, clicked, laid_out

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("coarse_maps", "drawings_made_once"),
]

# Pages whose drawings differ from those of all others take seconds each.
LONG_PAGES = ("unexplained", "holdout", "bare", "one_stroke")
PAGES = (
    "no_gap",
    "excess_scatter",
    "cause_found",
    "class_found",
    "other_form",
    "ambiguous",
    "class",
    "pair",
    "hostile",
    *LONG_PAGES,
)
each_page = pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] * (name in LONG_PAGES))
        for name in PAGES
    ],
)
SHEET_HEADINGS = ("Possible causes", "How far", "Next step", "Fit and files")
LINK = "{http://www.w3.org/1999/xlink}href"
MIN_LETTER = 9.0  # px, font size of the smallest text in a figure
SCREEN_HEIGHT = 800  # px, at 1280 px
PHONE_SCREENS_HEIGHT = 2 * 844  # px, at 390 px
SCATTER = ExcessScatter(
    ratio=2.4,
    channel="efficiency",
    time_scale="minutes",
    quantities=(("oil_temperature", 0.64), ("charge_pressure", 0.2)),
    sensor="the oil temperature",
    sentence="Readings scatter 2.4 times their stated noise, over minutes.",
)
DISAGREEMENT = Agreement(
    stated=True,
    holds=False,
    ratio=2.4,
    looks=(Look("efficiency", "session 2", 16, 3.4, 0.002),),
)
HOSTILE = '<img src=x onerror=alert(1)> "quoted" & \x00\x1b \u202e \udcff'


IN_WORDS = {
    "verdict",
    "causes",
    "sets",
    "classes",
    "members",
    "scatter",
    "agreement",
    "next_tests",
    "set_is_settled",
    "warnings",
    "notes",
}
"""Attributes of a diagnosis that the page states in words and in no drawing."""


@pytest.fixture(scope="module")
def drawings_made_once() -> Iterator[None]:
    """Make the drawings of two pages once where their diagnoses differ in words alone."""
    made: dict[tuple[object, ...], object] = {}

    def once(draw: Callable[[Diagnosis], object]) -> Callable[[Diagnosis], object]:
        def drawing(found: Diagnosis) -> object:
            names = {field.name for field in fields(found)} - IN_WORDS
            shown = [getattr(found, name) for name in sorted(names)]
            key = (draw, *map(id, shown))
            if key not in made:
                made[key] = draw(found)
                kept.append(shown)  # an id names nothing else while its object lives
            return made[key]

        return drawing

    kept: list[object] = []
    with pytest.MonkeyPatch.context() as patch:
        for draw in (
            figures.lead_map,
            figures.page_maps,
            figures.residuals,
            figures.watts,
        ):
            patch.setattr(figures, draw.__name__, once(draw))
        yield


@functools.cache
def diagnosis(name: str) -> Diagnosis:
    if name == "class":
        return hmcvt.diagnose(
            BASE, campaign((ChargePump(10.0),), seed=2, n=48), noise=NOISE
        )
    if name == "class_found":
        in_class = Member(("charge_pump", "bearing_drag"), "pump", 0.93, True, 1740.0)
        return replace(diagnosis("class"), verdict=name, members=(in_class,))
    if name == "other_form":
        leading = Member(("charge_pump",), "pump", 0.996, False, 820.0)
        return replace(diagnosis("class"), verdict=name, members=(leading,))
    if name == "excess_scatter":
        return replace(
            diagnosis("no_gap"), verdict=name, scatter=SCATTER, agreement=DISAGREEMENT
        )
    if name == "ambiguous":
        return replace(diagnosis("class"), verdict="ambiguous", classes=())
    found = diagnosis("ambiguous")
    first, second, *others = found.causes
    clear = replace(first, indistinguishable_from=())
    if name == "no_gap":
        return replace(
            found,
            verdict=name,
            causes=(),
            where=(),
            next_tests=(),
            gap=replace(found.gap, p_value=0.3, significant=False),
            posterior=replace(found.posterior, no_gap=0.95),
            residuals_after=(found.residuals_before),
        )
    if name == "cause_found":
        alone = CauseSet((first.effect,), 0.97, first.gap_after, first.shrinkage)
        return replace(
            found,
            verdict=name,
            causes=(clear,),
            sets=(alone,),
            next_tests=(),
            set_is_settled=True,
        )
    if name == "pair":
        pair = (
            replace(clear, together_with=second.effect),
            replace(
                second, together_with=first.effect, indistinguishable_from=("churning",)
            ),
        )
        both = CauseSet((first.effect, second.effect), 0.6, first.gap_after, None)
        return replace(found, causes=(*pair, *others), sets=(both, *found.sets[:2]))
    if name == "unexplained":
        return keeping_base(replace(many(found), verdict=name, next_tests=()))
    if name == "one_stroke":
        alike = one_stroke(diagnosis("pair"))
        return replace(alike, verdict="cause_found", set_is_settled=True)
    if name == "holdout":
        return replace(
            found,
            shrinkage=replace(found.shrinkage, on="holdout"),
            warnings=("The ratio at stroke 0 is 1.31, the file says 1.20",),
            judged=found.samples.select(np.arange(30)),
            residuals_before=found.residuals_before[:30],
            residuals_after=found.residuals_after[:30],
        )
    return {"hostile": hostile, "bare": bare}[name](found)


def hostile(found: Diagnosis) -> Diagnosis:
    """Every text that comes from outside is markup, and every number that can be is missing."""
    bad = replace(
        found.causes[0],
        effect=HOSTILE,
        form=HOSTILE,
        summary=HOSTILE,
        source=HOSTILE,
        remedy=HOSTILE,
        component=HOSTILE,
        indistinguishable_from=(HOSTILE,),
        together_with=HOSTILE,
        shrinkage=None,
        parameters={
            HOSTILE: {
                "value": float("nan"),
                "unit": HOSTILE,
                "meaning": HOSTILE,
                "interval": [float("-inf"), float("inf")],
                "plausible": False,
            }
        },
        drift={
            HOSTILE: {
                "without_effect": 0.0,
                "with_effect": 1e-30,
                "standard_errors": float("inf"),
            }
        },
    )
    point = {"displacement_ratio": 0.5, "engine_speed": 150.0, "load_torque": 300.0}
    tests = (
        NextTest(None, (HOSTILE, HOSTILE), 0.0, HOSTILE),
        NextTest(point, (HOSTILE, HOSTILE), 3.0, HOSTILE),
        NextTest(None, ("churning", "charge_pump"), 0.0, None),
    )
    return replace(
        found,
        samples=replace(found.samples, source=HOSTILE),
        causes=(bad, *found.causes[1:]),
        sets=(replace(found.sets[0], effects=(HOSTILE,), shrinkage=None),),
        warnings=(HOSTILE,),
        next_tests=tests,
        notes=(HOSTILE,),
        shrinkage=replace(found.shrinkage, interval=None),
    )


def bare(found: Diagnosis) -> Diagnosis:
    """A gap of which nothing more is known, and a model that stalls at every point."""
    stalled = replace(found.base, parameters=hmcvt.HydraulicParameters(9e-9, 0.1, 0.1))
    nothing = np.full(4, np.nan)
    return replace(
        found,
        residuals=np.full(len(found.samples), np.nan),
        judged=found.samples.select(np.arange(4)),
        where=(),
        causes=(),
        next_tests=(),
        notes=(),
        base=stalled,
        shrinkage=ShrinkageSummary(0.01, 0.01, None, None, "holdout"),
        residuals_before=nothing,
        residuals_after=nothing,
    )


def many(found: Diagnosis) -> Diagnosis:
    """More samples than can be drawn one by one; the outcome is that of fewer."""
    samples = campaign((ChargePump(6.0),), 3, 10_000)
    errors = samples.efficiency - found.base.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque
    )
    return replace(
        found,
        samples=samples,
        residuals=errors,
        judged=samples,
        residuals_before=errors,
        residuals_after=errors / 5.0,
    )


def one_stroke(found: Diagnosis) -> Diagnosis:
    """A campaign at one displacement ratio: an axis without extent."""
    same = np.full(len(found.samples), 0.5)
    where = tuple(
        replace(region, limits={**region.limits, "displacement_ratio": (0.5, 0.5)})
        for region in found.where
    )
    samples = replace(found.samples, displacement_ratio=same)
    return replace(found, samples=samples, judged=samples, where=where)


@functools.cache
def page(name: str) -> str:
    return html(diagnosis(name))


@functools.cache
def parsed(name: str) -> ET.Element:
    return ET.fromstring(page(name))


def text(name: str) -> str:
    return re.sub(r"\s+", " ", " ".join(parsed(name).find("body").itertext()))


def figure(name: str, identity: str) -> str:
    found = re.search(rf'<svg [^>]*id="{identity}".*?</svg>', page(name), re.DOTALL)
    assert found is not None
    return found[0]


@each_page
def test_is_well_formed_loads_nothing_and_runs_its_own_script_alone(name: str) -> None:
    items = list(parsed(name).iter())
    names = [item.get("id") for item in items if item.get("id")]
    assert len(names) == len(set(names)) > 100
    titles = [
        item.get("aria-labelledby") for item in items if item.get("role") == "img"
    ]
    assert len(titles) >= 5 and set(titles) <= set(names)
    assert not {item.tag.rsplit("}")[-1] for item in items} & {
        "link",
        "img",
        "iframe",
        "object",
        "embed",
        "image",
        "base",
    }
    scripts = [item.text for item in items if item.tag.rsplit("}")[-1] == "script"]
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert len(scripts) == 1 and f"script-src 'sha256-{digest}'" in page(name)
    assert not set(re.findall(r"https?:|fetch|XMLHttp|import|eval", scripts[0]))
    keys = {key for item in items for key in item.attrib}
    assert not [key for key in keys if key.startswith("on")]
    assert not keys & {"src", "srcset", "href", "action"}
    used = {item.get(LINK) for item in items if item.get(LINK)}
    used |= set(re.findall(r"url\(([^)]*)\)", page(name)))
    assert used <= {f"#{each}" for each in names}
    assert "@import" not in page(name)


@each_page
def test_shows_no_missing_number_as_code_does(name: str) -> None:
    shown = text(name) + " ".join(
        value for item in parsed(name).iter() for value in item.attrib.values()
    )
    assert re.findall(r"\b(?:nan|NaN|None|inf|Infinity|True|False)\b", shown) == []
    labels = re.findall(r"<(?:text|h4|dt|title)[^>]*>([^<]*)", page(name))
    assert len(labels) > 50 and [label for label in labels if "_" in label] == []


def test_escapes_every_text_from_outside() -> None:
    assert not re.search(
        r"<img|[\x00-\x08\x0b-\x1f\u202a-\u202e\ud800-\udfff]", page("hostile")
    )
    # Title, heading and data; warning; sets; cause; sizes; tests; notes.
    assert text("hostile").count("<img src=x onerror=alert(1)>") >= 14
    assert "<img src=x" in parsed("hostile").findtext("head/title")


@pytest.mark.parametrize(
    ("name", "badge", "first"),
    [
        ("no_gap", "No gap", "Bench and model agree: nothing to look for."),
        ("cause_found", "Cause found", "Probably "),
        pytest.param("one_stroke", "Cause found", "Probably ", marks=pytest.mark.long),
        ("pair", "Ambiguous", "Perhaps "),
        pytest.param(
            *("unexplained", "Unexplained", "A loss that is not in the library"),
            marks=pytest.mark.long,
        ),
        pytest.param(
            *("holdout", "Ambiguous", "The readings do not fit this machine"),
            marks=pytest.mark.long,
        ),
    ],
)
def test_says_the_sentence_for_the_mechanic_first(
    name: str, badge: str, first: str
) -> None:
    found = diagnosis(name)
    told = [
        " ".join(" ".join(item.itertext()).split())
        for item in parsed(name).find("body/header")
    ]
    assert told[:3] == ["Model against bench: simulated", badge, words.mechanic(found)]
    assert told[2].startswith(first) and len(told[2].split()) <= 25
    assert told[3:] == [f"{each}." for each in found.warnings]
    answer, grounds = list(parsed(name).find("body/main"))[:2]
    assert answer.get("class") == "answer"
    folded = " ".join(" ".join(grounds.itertext()).split())
    assert folded.startswith("The grounds") and words.verdict(found) in folded


def test_sets_of_causes_stand_in_a_table_with_the_unlisted() -> None:
    found = diagnosis("pair")
    first = found.sets[0]
    rows = [
        [" ".join(cell.itertext()).strip() for cell in row]
        for row in parsed("pair").iter("tr")
    ]
    assert [
        words.named(first.effects),
        "60 %",
        words.amount(found, first.gap_after),
        words.NOTHING,
    ] in rows
    assert [
        "something unlisted",
        words.probability(found.unlisted),
        *2 * [words.NOTHING],
    ] in rows


def test_figures_of_the_page_are_those_of_the_diagnosis() -> None:
    found = diagnosis("ambiguous")
    limits = np.array(found.where[0].limits["engine_speed"])
    assert found.shrinkage.fraction is not None
    for told in (
        f"{100 * found.shrinkage.before:.2f} points",
        f"{100 * found.gap.noise:.2f} points",
        f"{100 * found.shrinkage.fraction:.0f} %",
        "{:.0f} to {:.0f}".format(*limits * 30.0 / np.pi),
        "{:.1f} to {:.1f}".format(*limits),
        found.causes[0].source,
        found.model.fingerprint,
    ):
        assert told in text("ambiguous")
    for number, values in enumerate((found.residuals_before, found.residuals_after)):
        rms = 100.0 * np.sqrt(np.mean(values**2))
        assert f": {rms:.2f} points rms" in figure("ambiguous", f"residuals-{number}")


@pytest.mark.parametrize(
    "view",
    [
        "displacement-ratio-engine-speed",
        "displacement-ratio-load-torque",
        "engine-speed-load-torque",
    ],
)
def test_map_shows_every_sample_on_its_side_and_tells_it(view: str) -> None:
    found, drawn = diagnosis("ambiguous"), figure("ambiguous", f"map-{view}")
    told = re.findall(r"N·m: (\S+) points</title>", drawn)
    errors = 100.0 * found.residuals_before
    assert sorted(
        float(each.replace(words.MINUS, "-")) for each in told
    ) == pytest.approx(np.sort(errors), abs=0.0051)
    for kind, expected in (
        ("below", errors < -2 * 100 * found.gap.noise),
        ("above", errors > 2 * 100 * found.gap.noise),
        ("within", np.abs(errors) <= 2 * 100 * found.gap.noise),
    ):
        marks = re.search(
            rf'<g id="map-{view}-{kind}">(.*?)</g>\s*(?:</g>\s*)?<g id', drawn
        )
        count = 0 if marks is None else marks[1].count("<title>")
        assert count == expected.sum(), kind


def test_the_script_sorts_the_table_and_finds_a_test_everywhere(tmp_path: Path) -> None:
    seen = clicked(
        page("cause_found"),
        tmp_path,
        """
        const rows = () => [...page.querySelectorAll('#residual-table tbody tr')];
        const first = page.querySelector('#residual-table th:nth-child(3)');
        const speeds = () => rows().map(row => parseFloat(row.cells[2].textContent));
        first.click(); const up = speeds(); first.click(); const down = speeds();
        const mark = page.querySelector('svg [data-test]');
        mark.dispatchEvent(new MouseEvent('click', {bubbles: true}));
        const hit = rows().filter(row => row.classList.contains('hit'));
        return {up: up, down: down, hit: hit.map(row => row.dataset.test),
                marks: page.querySelectorAll('svg .hit').length, name: mark.dataset.test};""",
    )
    assert seen["up"] == sorted(seen["up"]) and seen["down"] == sorted(
        seen["up"], reverse=True
    )
    assert len(seen["up"]) == len(diagnosis("cause_found").samples)
    # In the map of the answer, the three maps, and the residuals before and after.
    assert seen["hit"] == [seen["name"]] and seen["marks"] == 6


@pytest.mark.long
def test_of_many_samples_an_even_part_is_drawn_on_a_page_of_moderate_size() -> None:
    for drawn in ("map-displacement-ratio-load-torque", "residuals-0"):
        assert 200 < figure("unexplained", drawn).count(" points</title>") <= 400
    assert (
        text("unexplained").count("A part of the samples is drawn, evenly picked.") == 2
    )
    assert "evenly picked" not in text("ambiguous")
    assert len(page("unexplained")) < 1_000_000


def test_next_tests_come_in_both_units_of_speed_and_implausible_sizes_are_tagged() -> (
    None
):
    assert re.search(r"0\.50 1432 150\.0 300 3\b", text("hostile"))
    assert (
        "A channel that is not logged yet : distinguishes churning from charge pump."
        in text("hostile")
    )
    assert "implausible size" in text("hostile")
    assert "implausible size" not in text("cause_found")


def test_every_cause_says_what_it_is_not_told_from() -> None:
    causes = diagnosis("ambiguous").causes
    assert causes[0].indistinguishable_from, "this campaign is meant to leave twins"
    articles = [
        " ".join(" ".join(item.itertext()).split())
        for item in parsed("ambiguous").iter("article")
    ]
    assert len(articles) == len(causes)
    for article, cause in zip(articles, causes, strict=True):
        twins = [words.plain(twin) for twin in cause.indistinguishable_from]
        assert article.startswith(words.plain(cause.effect))
        assert (
            f"Confounded with {words.listed(twins)}, by these data" in article
        ) == bool(twins)
    assert "Confounded with" not in text("cause_found")


def test_watts_stack_up_to_the_loss_of_the_model() -> None:
    found = diagnosis("cause_found")
    rows = re.findall(
        r'<td>([a-z ]+)</td>\s*<td class="number">(\d+)</td>\s*<td class="number">'
        r"(\d+)</td>",
        page("cause_found"),
    )
    losses = {part: (int(before), int(after)) for part, before, after in rows}
    strokes = np.linspace(-1.0, 1.0, 201)
    for place, model in enumerate((found.base, found.model)):
        parts = model.breakdown(
            strokes,
            float(np.median(found.samples.engine_speed)),
            float(np.median(found.samples.load_torque)),
        )
        lost = np.mean(parts.input_power - parts.output_power)
        assert losses["total"][place] == pytest.approx(lost, abs=0.51)
        assert losses["leakage"][place] == pytest.approx(
            np.mean(parts.losses["leakage"]), abs=0.51
        )
    assert losses["charge pump"][0] == 0 < losses["charge pump"][1]
    assert "charge pump: " in figure("cause_found", "watts-1")


@pytest.mark.long
def test_watts_of_a_model_that_stalls_are_no_answer() -> None:
    assert "no answer" in figure("bare", "watts-0")


BROKEN = """<!DOCTYPE html>
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<body><p style="width:900px">wide</p><img src="http://127.0.0.1:9/x.png">
<svg role="img" id="bad" viewBox="0 0 100 100" width="100"><text x="5" y="50">one</text>
<text x="8" y="52">other</text><text x="90" y="90">cut off</text></svg></body>"""


IN_THE_BROWSER = ("cause_found", "hostile")
"""Pages that `make test` lays out; the others differ in lengths of texts and in numbers of rows."""


@pytest.fixture(scope="module")
def layout(tmp_path_factory: pytest.TempPathFactory) -> Layout:
    pages = {name: page(name) for name in IN_THE_BROWSER} | {"broken": BROKEN}
    return laid_out(pages, tmp_path_factory.mktemp("browser"))


def test_fits_a_screen_and_a_phone_without_overlaps(layout: Layout) -> None:
    check_layout(layout, IN_THE_BROWSER)


@pytest.mark.long
def test_every_page_fits_a_screen_and_a_phone(tmp_path: Path) -> None:
    others = [name for name in PAGES if name not in IN_THE_BROWSER]
    check_layout(laid_out({name: page(name) for name in others}, tmp_path), others)


def check_layout(layout: Layout, pages: Iterable[str]) -> None:
    """Assert that nothing overlaps, is cut off or too small on the pages."""
    for name in (f"{name}@{width}" for name in pages for width in (1280, 390)):
        seen = layout.pages[name]
        faults = [seen[each] for each in ("beyond", "crossing", "clipped", "covered")]
        assert faults == [[], [], [], []], name
        assert seen["scroll"] <= seen["width"] and seen["figures"] >= 5, name
        assert seen["smallest"] >= MIN_LETTER, name
        if not name.startswith("hostile"):
            is_wide = name.endswith("@1280")
            room = SCREEN_HEIGHT if is_wide else PHONE_SCREENS_HEIGHT
            assert 0.0 < seen["answer"] <= room, name


def test_measures_see_a_broken_page_and_nothing_else_is_complained_of(
    layout: Layout,
) -> None:
    seen = layout.pages["broken@390"]
    assert seen["scroll"] > 390 and seen["crossing"] and seen["clipped"]
    assert "Content-Security-Policy" in page(
        "hostile"
    ) and "default-src 'none'" in page("hostile")
    assert layout.console and all("127.0.0.1:9" in line for line in layout.console)


def test_map_shows_the_gap_with_its_uncertainty() -> None:
    for view in views(diagnosis("ambiguous")):
        drawn = figure(
            "ambiguous", f"map-{view[0].name}-{view[1].name}".replace("_", "-")
        )
        assert "estimated gap [points]" in drawn and "<pattern" in drawn  # hatches
        assert "standard deviation of the estimate [points]" in drawn
        gap = estimate(diagnosis("ambiguous"), view)
        assert gap is not None and (gap.deviation > 0.0).all()
    assert "hatched: less than two standard deviations" in text("ambiguous")
    assert "dashed contours: bench below model" in text("ambiguous")


def test_each_map_states_the_values_of_the_other_axes() -> None:
    found = diagnosis("ambiguous")
    stroke, speed, load = found.axes
    median = float(np.median(found.samples.load_torque))
    drawn = figure("ambiguous", "map-displacement-ratio-engine-speed")
    drawn = drawn.replace("\N{NO-BREAK SPACE}", " ")
    assert f">at load {median:.0f} N·m<" in drawn
    assert f", at load {median:.0f} N·m; triangles" in drawn
    assert held_values(found, (stroke, speed)) == {"load_torque": median}
    gap = estimate(found, (load, speed))
    assert gap is not None
    mean, deviation = found.gap_at(
        np.median(found.samples.displacement_ratio),
        gap.up * np.pi / 30.0,
        gap.across,
    )
    np.testing.assert_allclose(gap.mean, 100.0 * mean)
    np.testing.assert_allclose(gap.deviation, 100.0 * deviation)


def test_contours_of_a_map_are_round_and_differ_without_colour() -> None:
    _, axes = plt.subplots()
    found = diagnosis("ambiguous")
    draw_view(axes, found, views(found)[2])
    plt.close(axes.figure)
    (lines,) = [item for item in axes.collections if item.get_hatch() is None][1:2]
    assert lines.levels.tolist() == (-lines.levels[::-1]).tolist()
    step = lines.levels[1] - lines.levels[0]
    assert step / 10.0 ** np.floor(np.log10(step)) in (1.0, 2.0, 2.5, 5.0)
    assert 5 <= len(lines.levels) <= 19
    dashed = [style[1] is not None for style in lines.get_linestyles()]
    assert dashed == (lines.levels < 0.0).tolist()


def test_python_draws_residuals_or_maps() -> None:
    found = diagnosis("ambiguous")
    assert len(found.plot().axes) == 2
    labels = [axes.get_xlabel() for axes in found.plot(of="gap").axes]
    assert labels.count("engine speed [r/min]") == 2  # the gap, its deviation
    bars = [label for label in labels if label.endswith("[points]")]
    assert len(bars) == 6
    with pytest.raises(hmcvt.InputError, match="none of residuals, gap"):
        found.plot(of="losses")


def test_recorded_temperature_is_an_axis_of_maps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = diagnosed("oil")
    samples = found.samples
    names = [(across.name, up.name) for across, up in views(found)]
    assert len(names) == 6
    assert all("oil_temperature" not in pair for pair in names[:3])
    assert [pair[1] for pair in names[3:]] == ["oil_temperature"] * 3
    with_oil_held, over_oil = views(found)[0], views(found)[3]
    gap = estimate(found, over_oil)
    assert gap is not None
    assert np.ptp(gap.mean, axis=0).max() > 0.5  # points, by the oil
    with monkeypatch.context() as patch:
        patch.setattr(gap_map, "views", lambda _: [with_oil_held, over_oil])
        drawings, _ = page_maps(found)
    shown_page = " ".join(drawings).replace("\N{NO-BREAK SPACE}", " ")
    assert "oil temperature [°C]" in shown_page
    oil = np.median(found.samples.oil_temperature)
    assert f"N·m, oil temperature {oil:.0f} °C; triangles" in shown_page
    # All samples are as warm: nothing is known along this axis.
    even = replace(samples, oil_temperature=np.full(len(samples), 60.0))
    assert len(views(replace(found, samples=even))) == 3


def tractor() -> hmcvt.EfficiencyModel:
    return hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))


def campaign_in_stages() -> hmcvt.BenchSamples:
    """Tests of a tractor with a charge pump in two of its stages."""
    worn = replace(tractor(), effects=(ChargePump(8.0),))
    rng = np.random.default_rng(1)
    stage = np.array(["HM3"] * 16 + ["HM4"] * 24)
    stroke = rng.uniform(-1.0, 1.0, 40)
    speed = rng.uniform(80.0, 220.0, 40)
    load = rng.uniform(80.0, 350.0, 40)
    efficiency = worn.efficiency(stroke, speed, load, stage=stage)
    return hmcvt.BenchSamples(
        displacement_ratio=stroke,
        engine_speed=speed,
        load_torque=load,
        efficiency=efficiency + 0.004 * rng.standard_normal(40),
        extra={"stage": stage},
    )


@functools.cache
def of_stages() -> Diagnosis:
    return hmcvt.diagnose(tractor(), campaign_in_stages(), noise=0.004)


@functools.cache
def page_of_stages() -> str:
    return html(of_stages())


@pytest.mark.long
def test_page_and_report_of_several_stages() -> None:
    found = of_stages()
    shown = page_of_stages()
    rows = stage_rows(found)
    assert [row[:2] for row in rows] == [("HM3", "16"), ("HM4", "24")]
    assert all(cell in shown for row in rows for cell in row)
    assert shown.count("<h3>By stage</h3>") == 2  # residuals, watts
    names = re.findall(r'<svg [^>]*id="(map-[a-z0-9-]*)"', shown)
    assert len(names) == len(set(names)) == 3  # one for each pair of axes
    drawn = re.search(
        r'<svg [^>]*id="map-engine-speed-load-torque".*?</svg>', shown, re.DOTALL
    )
    assert drawn is not None
    assert drawn[0].count(" points</title>") == 16 + 24
    letters = drawn[0].replace("\N{NO-BREAK SPACE}", " ")
    for stage in ("HM3", "HM4"):
        assert f">stage {stage}, at" in letters
        assert f", stage {stage}, at displacement ratio" in letters
    lines = found.report().splitlines()
    assert any(line.startswith("stages     HM3: 16 samples, mean ") for line in lines)
    assert any(line.startswith("           HM4: 24 samples, mean ") for line in lines)
    assert "stages HM3, HM4</h1>" in shown


@pytest.mark.long
def test_the_stage_of_the_next_test_is_named() -> None:
    point = {"displacement_ratio": 0.5, "engine_speed": 150.0, "load_torque": 200.0}
    named = ("charge pump", "bearing drag")
    test = NextTest(point, named, 0.3, setting={"stage": "HM3"})
    without = NextTest(None, named, 0.0, "measure the charge pressure")
    found = replace(of_stages(), next_tests=(test, without))
    assert labels_of_tests(found) == ["stage"]
    (row,) = rows_of_tests(found)
    assert row[2:4] == ("HM3", "0.50")
    assert labels_of_tests(diagnosis("ambiguous")) == []
    assert re.search(r">distinguishes</th>\s*<th[^>]*>stage</th>", html(found))


def test_answer_names_every_kind_of_verdict() -> None:
    found = text("class_found")
    assert "One of a class" in found
    assert "charge pump or bearing drag 93 %" in found
    assert "1700 W lost on average" in found
    assert "in a form that is not in the library" in text("other_form")
    assert "820 W lost on average" in text("other_form")
    scatter = text("excess_scatter")
    assert "Scatter above its statement" in scatter
    assert "What may have varied oil temperature 64 %" in scatter
    assert "record the oil temperature with each test." in scatter
    assert "efficiency session 2 16 3.4 0.002" in scatter


@pytest.mark.long
def test_answer_takes_its_map_where_the_gap_is_largest() -> None:
    found = of_stages()
    points = found.posterior.base_only.fit.observed.points
    named = {name: points[name] for name in (*(a.name for a in found.axes), "stage")}
    mean, deviation = found.gap_at(**named)
    clear = np.where(np.abs(mean) >= 2.0 * deviation, np.abs(mean), 0.0)
    row = int(clear.argmax())
    entry = largest_gap_map(found)
    assert entry.stage == list(found.base.stages)[int(points["stage"][row])]
    assert entry.held == {name: points[name][row] for name in entry.held}
    shown = lead_map(found)
    assert f"stage {entry.stage}, at " in shown.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.long
def test_picture_of_many_stages_and_axes_keeps_a_readable_size() -> None:
    from matplotlib.figure import Figure

    rng = np.random.default_rng(2)
    stage = np.repeat(["HM1", "HM2", "HM3", "HM4"], 10)
    count = len(stage)
    points = {
        "displacement_ratio": rng.uniform(-0.6, 0.6, count),
        "engine_speed": rng.uniform(120.0, 220.0, count),
        "load_torque": rng.uniform(150.0, 350.0, count),
    }
    efficiency = replace(tractor(), effects=(ChargePump(8.0),)).efficiency(
        *points.values(), stage=stage
    )
    for oil in (None, rng.uniform(45.0, 85.0, count)):
        samples = hmcvt.BenchSamples(
            **points,
            efficiency=efficiency + 0.004 * rng.standard_normal(count),
            oil_temperature=oil,
            extra={"stage": stage},
        )
        found = hmcvt.diagnose(tractor(), samples, noise=0.004)
        drawn = Figure()
        draw_gap(drawn, found)
        width, height = 130.0 * drawn.get_size_inches()
        assert width < 2800.0 and height < 2000.0
        draw_sheet(Figure(), found)  # along recorded axes no region has limits


def test_stages_are_in_one_order() -> None:
    samples = campaign_in_stages()
    backward = samples.select(np.arange(len(samples))[::-1])
    assert stages_of(samples) == stages_of(backward) == ["HM3", "HM4"]


@pytest.mark.long
def test_sheet_of_several_stages() -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.27, 11.69))
    draw_sheet(figure, of_stages(), datetime.date(2026, 2, 3))
    lines = [text.get_text() for text in figure.texts]
    assert lines[0].endswith("stages HM3, HM4")
    assert not any(line.startswith("candidates: ") for line in lines)
    headings = [line for line in lines if line in SHEET_HEADINGS]
    assert headings == list(SHEET_HEADINGS)
    assert any(line.startswith("Map of the gap, stage HM") for line in lines)
    assert any("2026-02-03" in line for line in lines)
    bottom = min(text.get_position()[1] for text in figure.texts)
    assert bottom > 0.03


def test_sheet_names_tests_and_rows_that_were_left_out() -> None:
    from matplotlib.figure import Figure

    rows = "left out of bench.csv: row 6: no number"
    found = diagnosis("ambiguous")
    found = replace(
        found, left_out=("sample 7 (stroke 0.3)",), notes=(*found.notes, rows)
    )
    figure = Figure(figsize=(8.27, 11.69))
    draw_sheet(figure, found, datetime.date(2026, 2, 3), [rows])
    text = " ".join(line.get_text() for line in figure.texts)
    assert "Left out as tests that stand apart: sample 7 (stroke 0.3)" in text
    assert text.count(rows) == 1
    assert min(line.get_position()[1] for line in figure.texts) > 0.03


def test_sheet_is_one_page_of_pdf(tmp_path: Path) -> None:
    path = tmp_path / "report.pdf"
    write_report(diagnosis("ambiguous"), path)
    content = path.read_bytes()
    assert content.startswith(b"%PDF-") and content.rstrip().endswith(b"%%EOF")
    assert len(re.findall(rb"/Type /Page\b", content)) == 1
    with pytest.raises(hmcvt.InputError, match=r"report\.txt: a report ends in"):
        write_report(diagnosis("ambiguous"), tmp_path / "report.txt")


def test_every_report_has_the_same_next_step() -> None:
    found = diagnosis("ambiguous")
    steps = words.next_step(found)
    said = " ".join(found.report().split())
    assert f"next step {' '.join(steps)}" in said
    texts = unescape(" ".join(page("ambiguous").split()))
    assert all(step[1:] in texts for step in steps)

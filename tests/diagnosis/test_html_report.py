# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import functools
import re
import time
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis import Diagnosis, NextTest, ShrinkageSummary, diagnose
from hmcvt_core.files.resources import data_path
from hmcvt_core.physics.effects.drag import ChargePump
from hmcvt_core.physics.effects.gears import PlanetaryMesh
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.report.html_report import html, write_html

from .campaigns import BASE, NOISE, campaign
from .html_browser import browse, measured

WIDTHS = (1280, 390)
PAGES = ("no_gap", "cause_found", "pair", "unexplained", "paper", "holdout", "hostile", "bare",
         "many", "one_stroke")
LEAST_LETTER = 9.0  # px, font size of the smallest text in a figure


def banded() -> hmcvt.BenchSamples:
    """A loss in a narrow band of engine speed, which no effect in the library makes."""
    samples = campaign()
    inside = (samples.engine_speed > 140.0) & (samples.engine_speed < 165.0)
    return replace(samples, efficiency=samples.efficiency - 0.02 * inside)


@functools.cache
def diagnosis(name: str) -> Diagnosis:
    if name == "no_gap":
        return diagnose(BASE, campaign(), noise=NOISE)
    if name == "cause_found":
        return diagnose(BASE, campaign((PressureLeakage(1e-11, 1.5),)), noise=NOISE)
    if name == "pair":
        pair = (ChargePump(8.0), PlanetaryMesh(0.04))
        return diagnose(BASE, campaign(pair), noise=NOISE)
    if name == "unexplained":
        return diagnose(BASE, banded(), noise=NOISE)
    if name == "paper":
        return diagnose(BASE, hmcvt.read_bench(data_path("data/table2.csv")), noise=0.0085)
    if name == "holdout":
        drag = (ChargePump(6.0),)
        return diagnose(BASE, campaign(drag), campaign(drag, seed=5, n=30), noise=NOISE)
    return {"hostile": hostile, "bare": bare, "many": many, "one_stroke": one_stroke}[name]()


HOSTILE = '<img src=x onerror=alert(1)> "quoted" & \x00\x1b \u202e \udcff'


def hostile() -> Diagnosis:
    """Every text that comes from outside is markup, and every number that can be is missing."""
    found = diagnosis("pair")
    cause = found.causes[0]
    bad = replace(
        cause, effect=HOSTILE, form=HOSTILE, summary=HOSTILE, source=HOSTILE, remedy=HOSTILE,
        component=HOSTILE, indistinguishable_from=(HOSTILE,), together_with=HOSTILE,
        shrinkage=None,
        parameters={HOSTILE: {"value": float("nan"), "unit": HOSTILE, "meaning": HOSTILE,
                              "interval": [float("-inf"), float("inf")], "plausible": False}},
        drift={HOSTILE: {"without_effect": 0.0, "with_effect": 1e-30,
                         "standard_errors": float("inf")}})
    nowhere = NextTest(None, None, None, (HOSTILE, HOSTILE), 0.0, HOSTILE)
    somewhere = NextTest(0.5, 150.0, 300.0, (HOSTILE, HOSTILE), 3.0, HOSTILE)
    unmeasured = NextTest(None, None, None, ("churning", "charge_pump"), 0.0, None)
    return replace(
        found, samples=replace(found.samples, source=HOSTILE), causes=(bad, *found.causes[1:]),
        next_tests=(nowhere, somewhere, unmeasured), notes=(HOSTILE,), component=HOSTILE,
        shrinkage=replace(found.shrinkage, interval=None))


def bare() -> Diagnosis:
    """A gap of which nothing more is known, and a model that stalls at most points."""
    found = diagnosis("holdout")
    stalled = replace(found.base, parameters=hmcvt.HydraulicParameters(9e-9, 0.1, 0.1))
    nothing = np.full(4, np.nan)
    return replace(
        found, where=(), causes=(), next_tests=(), notes=(), component=None, base=stalled,
        shrinkage=ShrinkageSummary(0.01, 0.01, None, None, "holdout"), residuals_before=nothing,
        residuals_after=nothing)


def many() -> Diagnosis:
    """More samples than can be drawn one by one; the outcome is that of fewer."""
    found, samples = diagnosis("cause_found"), campaign((PressureLeakage(1e-11, 1.5),), 3, 10_000)
    errors = samples.efficiency - found.base.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque)
    return replace(found, samples=samples, residuals_before=errors, residuals_after=errors / 5.0)


def one_stroke() -> Diagnosis:
    """A campaign at one displacement ratio: an axis without extent."""
    found = diagnosis("cause_found")
    same = np.full(len(found.samples), 0.5)
    where = tuple(replace(region, displacement_ratio=(0.5, 0.5)) for region in found.where)
    return replace(found, samples=replace(found.samples, displacement_ratio=same), where=where)


class Page(HTMLParser):
    """Checks nesting and collects what tests ask for."""

    VOID = frozenset({"meta", "br", "img", "link", "hr", "input"})

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(page)
        self.close()
        assert self.open == [], f"left open: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop() == tag, f"</{tag}> closes another element"

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.texts.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.texts))

    def values(self, name: str) -> list[str]:
        return [value for _, attributes in self.tags if (value := attributes.get(name))]


@functools.cache
def page(name: str) -> str:
    return html(diagnosis(name))


@functools.cache
def parsed(name: str) -> Page:
    return Page(page(name))


# --- the text of the page -------------------------------------------------------------------------


@pytest.mark.parametrize("name", PAGES)
def test_is_well_formed_with_unique_names(name: str) -> None:
    found = parsed(name)
    names = found.values("id")
    assert len(names) == len(set(names))
    assert set(found.values("aria-labelledby")) <= set(names)
    assert dict(found.tags)["html"]["lang"] == "en"
    drawings = [attributes for tag, attributes in found.tags
                if tag == "svg" and attributes.get("role") == "img"]
    assert len(drawings) >= 5
    assert all(attributes.get("aria-labelledby") for attributes in drawings)


@pytest.mark.parametrize("name", PAGES)
def test_loads_nothing_and_runs_nothing(name: str) -> None:
    found = parsed(name)
    tags = {tag for tag, _ in found.tags}
    assert not tags & {"script", "link", "img", "iframe", "object", "embed", "image", "use", "base"}
    for _, attributes in found.tags:
        for key, value in attributes.items():
            assert key not in ("src", "srcset", "href", "xlink:href", "action"), key
            assert not key.startswith("on"), key
            assert "url(" not in (value or "")
    assert set(re.findall(r"url\(([^)]*)\)", page(name))) <= {
        "#dots", "#lines", "#effect", "#effect-2"}
    assert "@import" not in page(name)


@pytest.mark.parametrize("name", PAGES)
def test_shows_no_missing_number_as_code_does(name: str) -> None:
    found = parsed(name)
    shown = found.text + " ".join(value or "" for _, attributes in found.tags
                                  for value in attributes.values())
    assert re.findall(r"\b(?:nan|NaN|None|inf|Infinity|True|False)\b", shown) == []
    labels = re.findall(r"<(?:text|h4|dt|li class)[^>]*>([^<]*)", page(name))
    assert [label for label in labels if "_" in label] == []


def test_escapes_every_text_from_outside() -> None:
    markup, found = page("hostile"), parsed("hostile")
    assert "<img" not in markup
    assert not re.search(r"[\x00-\x08\x0b-\x1f\u202a-\u202e\ud800-\udfff]", markup)
    markup.encode("utf-8")
    # Title, heading and data; cause; sizes; tests; notes.
    assert found.text.count("<img src=x onerror=alert(1)>") >= 15


@pytest.mark.parametrize(("name", "badge", "says"), [
    ("no_gap", "No gap", r"^No gap is seen"),
    ("cause_found", "Cause found",
     r"^(The bench lies|Bench and model differ) .*\d points .*;"
     r" pressure leakage \([^)]*\) explains it.*"
     r" On samples left out, with the effect picked anew without them each time, \d+ % of the"
     r" squared gap is removed \([^)]* to \d+ %\); \d+ % with pressure leakage held as the"
     r" effect\.$"),
    ("pair", None, r"together with .* is removed .*; \d+ % with .* with .* held as the effect"),
    ("unexplained", "Unexplained",
     r"mostly at medium engine speed\. No effect in the library explains it"),
    ("paper", "Ambiguous", r"^Bench and model differ|^The bench lies"),
    ("holdout", "Ambiguous",
     r"cannot tell it from .* On the samples held out, with the first cause added, \d+ %"),
])
def test_says_the_verdict_first(name: str, badge: str | None, says: str) -> None:
    markup = page(name)
    first = re.search(r'<p class="verdict">(.*?)</p>', markup)
    assert first is not None
    assert re.search(says, first[1].replace("&gt;", ">")), first[1]
    if badge is not None:
        assert f'<div class="badge">{badge}</div>' in markup


@pytest.mark.parametrize(("change", "says"), [
    ({"mean_residual": -0.012}, "The bench lies 1.20 points below the refitted model, mostly at "),
    ({"mean_residual": 0.012}, "The bench lies 1.20 points above the refitted model, mostly at "),
    ({"channel": "output_speed"}, "most clearly in the output speed at "),
    ({"p_value": 0.2}, "no single place stands out"),
])
def test_says_where_the_gap_lies(change: dict[str, Any], says: str) -> None:
    found = diagnosis("unexplained")
    region = replace(found.where[0], **{"channel": "efficiency", "p_value": 0.001} | change)
    assert says in Page(html(replace(found, where=(region,)))).text


def test_figures_of_the_page_are_those_of_the_diagnosis() -> None:
    found, text = diagnosis("cause_found"), parsed("cause_found").text
    assert found.shrinkage.fraction is not None
    assert f"{100 * found.shrinkage.before:.2f} points" in text
    assert f"{100 * found.gap.noise:.2f} points" in text
    assert f"{100 * found.shrinkage.fraction:.0f} %" in text
    region = found.where[0]
    low, high = (f"{speed * 30.0 / np.pi:.0f}" for speed in region.engine_speed)
    assert f"{low} to {high}" in text
    assert f"{region.engine_speed[0]:.1f} to {region.engine_speed[1]:.1f}" in text
    assert found.causes[0].source in text
    assert found.model.fingerprint in text


def marks(name: str, view: int) -> tuple[int, int, int]:
    """Count triangles down, triangles up and dots of one view of the map."""
    figure = re.search(rf'<svg id="map-{view}".*?</svg>', page(name), re.DOTALL)
    assert figure is not None
    return (len(re.findall(r'<polygon class="below', figure[0])),
            len(re.findall(r'<polygon class="above', figure[0])),
            len(re.findall(r'<circle class="within"', figure[0])))


@pytest.mark.parametrize("view", range(3))
def test_map_shows_every_sample_on_its_side(view: int) -> None:
    found = diagnosis("unexplained")
    errors, noise = found.residuals_before, found.gap.noise
    assert marks("unexplained", view) == (
        np.sum(errors < -noise), np.sum(errors > noise), np.sum(np.abs(errors) <= noise))


def test_map_of_many_samples_shows_means() -> None:
    assert 100 < sum(marks("many", 0)) <= 18 * 18
    assert "mean of the samples in one cell" in parsed("many").text


def test_next_tests_come_in_both_units_of_speed() -> None:
    text = parsed("hostile").text
    assert re.search(r"0\.50 1432 150\.0 300 3\.00", text)
    assert "A channel that is not logged yet : tells churning from charge pump." in text


def test_causes_that_cannot_be_told_apart_share_a_bracket() -> None:
    found = diagnosis("holdout")
    twins = found.causes[0].indistinguishable_from
    assert twins, "this campaign is meant to leave twins"
    bracket = re.search(r'<div class="group bracket">(.*?)</div><div class="group', page("holdout"))
    assert bracket is not None
    for name in (found.causes[0].effect, *twins):
        assert f"<h4>{name.replace('_', ' ')}" in bracket[1]


def test_implausible_size_is_tagged() -> None:
    assert "implausible size" in parsed("hostile").text
    assert "implausible size" not in parsed("cause_found").text


def test_stalled_points_are_named_in_the_breakdown() -> None:
    figure = re.search(r'<svg id="watts-0".*?</svg>', page("bare"), re.DOTALL)
    assert figure is not None
    assert figure[0].count("no answer") == 7


def test_same_diagnosis_gives_same_text_and_file(tmp_path: Path) -> None:
    path = tmp_path / "R.html"
    path.write_text("old", encoding="utf-8")
    write_html(diagnosis("paper"), str(path))
    assert path.read_text(encoding="utf-8") == html(diagnosis("paper")) == page("paper")
    assert [entry.name for entry in tmp_path.iterdir()] == ["R.html"]


def test_unwritable_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="missing"):
        write_html(diagnosis("paper"), tmp_path / "missing" / "R.html")


def test_ten_thousand_samples_make_a_page_of_moderate_size() -> None:
    found = diagnosis("many")
    start = time.perf_counter()
    markup = html(found)
    assert time.perf_counter() - start < 5.0
    assert len(markup) < 1_000_000


# --- the page in a browser ------------------------------------------------------------------------

BROKEN = """<!DOCTYPE html><body><p style="width:900px">wide</p>
<svg role="img" id="bad" viewBox="0 0 100 100" width="100"><text x="5" y="50">one</text>
<text x="8" y="52">other</text><text x="90" y="90">cut off</text></svg></body>"""


@pytest.fixture(scope="module")
def layout(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    pages = {name: page(name) for name in PAGES} | {"broken": BROKEN}
    return measured(pages, WIDTHS, tmp_path_factory.mktemp("browser"))


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", PAGES)
def test_fits_the_width_without_overlaps(
    layout: dict[str, dict[str, Any]], name: str, width: int
) -> None:
    seen = layout[f"{name}@{width}"]
    assert seen["width"] == width
    assert seen["scroll"] <= width, seen["beyond"]
    assert seen["beyond"] == []
    assert seen["figures"] >= 5
    assert seen["crossing"] == []
    assert seen["clipped"] == []
    assert seen["smallest"] >= LEAST_LETTER


def test_measures_see_a_broken_page(layout: dict[str, dict[str, Any]]) -> None:
    seen = layout["broken@390"]
    assert seen["scroll"] > 390
    assert seen["crossing"]
    assert seen["clipped"]


@pytest.mark.parametrize("name", ["hostile", "paper"])
def test_browser_has_nothing_to_complain_of(name: str, tmp_path: Path) -> None:
    path = tmp_path / "R.html"
    write_html(diagnosis(name), path)
    seen = browse(path, tmp_path)
    assert seen.console == []
    assert 'class="verdict"' in seen.document


def test_browser_complains_when_the_page_would_load_something(tmp_path: Path) -> None:
    path = tmp_path / "R.html"
    path.write_text(page("paper").replace("<main>", '<main><img src="http://127.0.0.1:9/x.png">'),
                    encoding="utf-8")
    assert any("Content Security Policy" in line for line in browse(path, tmp_path).console)

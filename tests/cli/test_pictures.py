# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The pictures as files: what stands in them, and how a browser lays them out."""

import importlib.util
import xml.etree.ElementTree as ET

import pytest
from diagnosis.html_browser import laid_out

from hmcvt_tools.report.style import LOSSES

from .running import POINT, ROOT, TABLE2, assert_refused

WORDS = {
    "map": {
        "engine speed [r/min]",
        "output speed / engine speed [-]",
        "efficiency [%]",
        "Efficiency at 23 kW, stage HM4",
        "best at an engine speed",
        "best at an output speed",
        "data of the identification",
    },
    "breakdown": {
        "displacement ratio [-]",
        "lost, % of engine power",
        "leakage",
        "motor damping",
        "Where the watts go: stage HM4, 1400 r/min, 200 N m",
    },
    "identify": {
        "predicted efficiency [%]",
        "measured efficiency [%]",
        "fitted (5)",
        "held out (3)",
        "mean error 2.02 % fitted, 1.60 % held out",
    },
}


def command(name, picture):
    return {
        "map": ("map", "--power", "23kW", "--bench", TABLE2, "--picture", picture),
        "breakdown": ("breakdown", *POINT, "--picture", picture),
        "identify": ("identify", TABLE2, "--fit", "1,2,4-6", "--picture", picture),
    }[name]


def texts(svg):
    return {
        "".join(item.itertext()).strip()
        for item in svg.iter("{http://www.w3.org/2000/svg}text")
    }


@pytest.mark.parametrize("name", WORDS)
def test_svg_says_what_it_shows(hmcvt, tmp_path, name):
    path = tmp_path / "picture.svg"
    assert hmcvt(*command(name, path)).code == 0
    found = texts(ET.parse(path).getroot())
    assert WORDS[name] <= found
    if name == "map":
        samples = hmcvt("predict", TABLE2, "--json").json
        residuals = {
            f"{100 * (one['measured'] - one['predicted']):+.1f}"
            for one in samples
            if abs(one["load_torque"] * one["engine_speed"] / 23e3 - 1.0) < 0.15
        }
        assert len(residuals) == 4 and residuals <= found
    if name == "breakdown":
        drawn = path.read_text(encoding="utf-8")
        assert all(LOSSES[part][0] in drawn for part in found & LOSSES.keys())
        # The same picture from the same input, so that it can be kept under version control.
        assert hmcvt(*command(name, path)).code == 0
        assert path.read_text(encoding="utf-8") == drawn


@pytest.mark.parametrize(
    ("options", "labels"),
    [
        (("--power", "90kW"), {"no data at this power"}),
        (("--params", ROOT / "params" / "paper.yaml"), set()),
    ],
)
def test_map_says_where_it_has_no_data(hmcvt, tmp_path, options, labels):
    path = tmp_path / "picture.svg"
    assert hmcvt("map", "--picture", path, *options).code == 0
    assert {
        text for text in texts(ET.parse(path).getroot()) if "data" in text
    } == labels


def test_pages_in_a_browser(hmcvt, tmp_path):
    pages = {}
    for name in WORDS:
        path = tmp_path / f"{name}.html"
        assert hmcvt(*command(name, path)).code == 0
        pages[name] = path.read_text(encoding="utf-8")
    seen = laid_out(pages, tmp_path)
    assert seen.console == []
    for where, found in seen.pages.items():
        assert found["figures"] == 1, where
        assert found["scroll"] <= found["width"], where
        assert not found["beyond"] and not found["clipped"], (where, found)


@pytest.mark.parametrize("missing", ["jinja2", "matplotlib"])
@pytest.mark.parametrize(
    "arguments",
    [("map", "--picture", "map.png"), ("diagnose", TABLE2, "--report", "R.html")],
)
def test_what_draws_is_missed_before_the_work(
    hmcvt, arguments, missing, tmp_path, monkeypatch
):
    present = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *more: None if name == missing else present(name, *more),
    )
    monkeypatch.chdir(tmp_path)
    assert_refused(hmcvt(*arguments), missing, 'pip install ".[report]"')
    assert list(tmp_path.iterdir()) == []

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The web site of the documentation: it builds, and no page is wider than the screen."""

import subprocess
import sys

import pytest
from cli.running import ROOT
from diagnosis.html_browser import laid_out

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

DOCS = ROOT / "docs"
PAGES = sorted(
    path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")
)
PARTS = 4  # a browser for each: all pages at once are too much for one
SOME = ("index", "diagnosis-reference", "node-reference")
"""Pages that `make test` lays out: the first one, and two of the widest tables."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("material", reason="needs the extra docs")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=250,
    )
    assert done.returncode == 0, done.stderr
    return folder


def _with_base(path):
    """Return the text of a page that finds its style sheets from any folder."""
    base = f'<head><base href="{path.parent.as_uri()}/">'
    return path.read_text("utf-8").replace("<head>", base, 1)


def test_the_site_is_built_and_fits_the_screen(site, tmp_path):
    check_widths(site, SOME, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_no_page_is_wider_than_the_screen(site, tmp_path, part):
    check_widths(site, PAGES[part::PARTS], tmp_path)


def check_widths(site, names, scratch):
    """Assert that no page is wider than the screen."""
    pages = {
        name.replace("/", "-"): _with_base(site / f"{name}.html") for name in names
    }
    measured = laid_out(pages, scratch).pages
    assert len(measured) == 2 * len(names)
    wide = {
        name: page["scroll"]
        for name, page in measured.items()
        if page["scroll"] > page["width"]
    }
    assert wide == {}

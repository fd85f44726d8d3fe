# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The web site of the documentation: it builds, and no page is wider than the screen."""

import subprocess
import sys

import pytest
from cli.running import ROOT
from diagnosis.html_browser import laid_out

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

PAGES = sorted(path.stem for path in (ROOT / "docs").glob("*.md"))
PARTS = 4  # a browser for each: all pages at once are too much for one


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


@pytest.mark.parametrize("part", range(PARTS))
def test_no_page_is_wider_than_the_screen(site, tmp_path, part):
    names = PAGES[part::PARTS]
    base = f'<head><base href="{site.as_uri()}/">'
    pages = {
        name: (site / f"{name}.html").read_text("utf-8").replace("<head>", base, 1)
        for name in names
    }
    measured = laid_out(pages, tmp_path).pages
    assert len(measured) == 2 * len(names)
    wide = {
        name: page["scroll"]
        for name, page in measured.items()
        if page["scroll"] > page["width"]
    }
    assert wide == {}

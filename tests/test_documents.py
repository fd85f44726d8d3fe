# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What stands beside the code: citation, changelog, the web site's table of contents."""

import re
from pathlib import Path

import yaml

import hmcvt_core as hmcvt

ROOT = Path(__file__).resolve().parent.parent


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def pages(nav):
    """Pages in the order of a table of contents."""
    if isinstance(nav, str):
        return [nav]
    parts = nav.values() if isinstance(nav, dict) else nav
    return [page for part in parts for page in pages(part)]


def test_citation_is_of_this_version():
    citation = yaml.safe_load(read("CITATION.cff"))
    assert citation["version"] == hmcvt.__version__
    # What the format asks for; GitHub shows nothing without them.
    assert citation["cff-version"] == "1.2.0"
    assert citation["title"] == "hmcvt" and citation["authors"] and citation["message"]
    assert citation["license"] == "Apache-2.0"
    paper, = citation["references"]
    assert paper["type"] == "article" and "HMCVT" in paper["title"] and paper["authors"]


def test_changelog_begins_with_this_version():
    versions = re.findall(r"^## (\S+)", read("CHANGELOG.md"), flags=re.MULTILINE)
    released = [version for version in versions if version.lower() != "unreleased"]
    assert released[0] == hmcvt.__version__
    entry = read("CHANGELOG.md").partition(f"## {hmcvt.__version__}")[2].partition("\n## ")[0]
    assert "\n* " in entry
    numbers = [tuple(map(int, version.split("."))) for version in released]
    assert numbers == sorted(set(numbers), reverse=True)


def test_web_site_has_every_page_once():
    settings = yaml.safe_load(read("mkdocs.yml"))
    named = pages(settings["nav"])
    assert sorted(named) == sorted(path.name for path in (ROOT / "docs").glob("*.md"))
    assert named[0] == "index.md"
    assert re.search(r"^docs:.*\n\t.*\n\t.*mkdocs build --strict$", read("Makefile"), re.MULTILINE)
    assert "site/" in read(".gitignore").splitlines()


def test_every_public_name_stands_on_the_page_of_the_api():
    named = re.findall(r"^::: hmcvt_core\.(\w+)$", read("docs/api.md"), re.MULTILINE)
    assert sorted(named) == sorted(set(hmcvt.__all__) - {"__version__"})
    for name in named:
        assert getattr(hmcvt, name).__doc__, name

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The pages on the design and the settings of the diagnosis, against the code."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "design-diagnosis.md"
SETTINGS = ROOT / "docs" / "settings.md"
PACKAGE = ROOT / "hmcvt_core" / "diagnosis"


@pytest.fixture
def settings_table(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import settings_table

    yield settings_table
    sys.modules.pop("settings_table")


def test_table_of_settings_is_current(settings_table):
    text = SETTINGS.read_text(encoding="utf-8")
    assert settings_table.page(text) == text, "run python docs/settings_table.py"


def test_every_setting_has_a_meaning_and_a_source(settings_table):
    for name, text in settings_table.documented_settings().items():
        meaning, _, source = text.partition("Source: ")
        assert meaning.strip() and source.strip(), name


def test_modules_on_the_page_exist():
    names = re.findall(r"\| `([a-z_/]+\.py)` \|", PAGE.read_text(encoding="utf-8"))
    assert len(set(names)) > 10
    for name in names:
        assert (PACKAGE / name).is_file(), name


def test_terms_of_the_page_are_in_the_code():
    text = PAGE.read_text(encoding="utf-8")
    glossary = text.split("## Terms in the code")[1].split("##")[0]
    code = "".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    rows = re.findall(r"^\| [^|]+ \| ([^|]+) \|", glossary, re.MULTILINE)
    terms = [term for row in rows for term in re.findall(r"`([^`]+)`", row)]
    assert len(terms) > 20
    for term in terms:
        last = re.split(r"[. ]", term)[-1]
        assert last in code, term

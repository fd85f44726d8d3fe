# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The page on the design of the diagnosis, and its settings, against the code."""

import ast
import itertools
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "design-diagnosis.md"
PACKAGE = ROOT / "hmcvt_core" / "diagnosis"


def documented_settings():
    """Return the docstring of each setting by its name."""
    body = ast.parse((PACKAGE / "settings.py").read_text(encoding="utf-8")).body
    pairs = itertools.pairwise(body)
    return {
        ast.unparse(setting.targets[0]): (
            str(text.value.value) if isinstance(text, ast.Expr) else ""
        )
        for setting, text in pairs
        if isinstance(setting, ast.Assign)
    }


def test_every_setting_has_a_meaning_and_a_source():
    documented = documented_settings()
    assert len(documented) > 50
    for name, text in documented.items():
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

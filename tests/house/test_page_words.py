# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The front pages are short, come first, and no page uses private words."""

import re
import tokenize

import pytest
import yaml
from cli.running import ROOT

DOCS = ROOT / "docs"
FRONT = (
    "predict.md",
    "identify.md",
    "diagnosis.md",
    "node.md",
    "export.md",
    "data-in.md",
)
MAX_FRONT_WORDS = 1500
MAX_TERMS = 20
SECTIONS = ["User guide", "Reference", "Design", "Studies"]

PRIVATE_WORDS = {
    r"alive": "candidate",
    r"allowances?": "uncertainty, or form error",
    r"bends?": "form error, or shape",
    r"anew": "again",
    r"believed?": "taken as correct",
    r"beside": "next to, or besides",
    r"books (it|them|this)": "attributes it to",
    r"company": "other effects in the set",
    r"complaints?": "message",
    r"deals": "fold assignments",
    r"foretell\w*|foretold": "predict, prediction",
    r"gives? way": "is replaced, or is skipped",
    r"handed over": "saved",
    r"hardly": "barely",
    r"is none|are none": "does not exist",
    r"minds?": "depends on",
    r"likeliest": "most probable",
    r"misfit": "form error",
    r"most part|least part": "max fraction, min fraction",
    r"nobody('s business)?": "no one, or the passive",
    r"of (one's|its|their) own": "separate, or your own",
    r"set(s|ting)? aside": "reject, or keep under another name",
    r"shall": "must, or the present tense",
    r"speaks? (against|for)": "contradict, support",
    r"told|tells?": "reported, shows, states",
    r"unsaid": "without a warning",
    r"who?ever|whose is": "you, or the name of the role",
    r"wastes? (the )?least": "loses least",
}
"""Private words by the words of the field that replace them."""

# Texts with values in them have separate tokens from Python 3.12 on.
TEXT = {
    getattr(tokenize, name)
    for name in ("STRING", "COMMENT", "FSTRING_MIDDLE")
    if hasattr(tokenize, name)
}

ALSO = (
    "../README.md",
    "../CONTRIBUTING.md",
    "../SECURITY.md",
    "../QUALITY_DECLARATION.md",
)
"""Texts outside docs/ that hold the same rule."""


def prose(text):
    """Return the text of a page without generated tables, code and targets of links."""
    generated = r"<!-- \w+: begin -->.*?<!-- \w+: end -->"
    text = re.sub(rf"{generated}|```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"^(    |\t).*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`]*`", "", text)
    return re.sub(r"\]\([^)]*\)", "]", text)


def pages():
    """Return every page of the documentation, and further texts of the project."""
    names = [path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")]
    return [*ALSO, *sorted(names)]


SWEPT = (
    "alive|anew|company|foretell|foretold|handed over|hardly|likeliest|nobody|unsaid|"
    "whoever|wastes (the )?least|speaks? (against|for)"
)
"""Private words that docstrings and messages no longer have."""
PACKAGES = ("hmcvt_core", "hmcvt_tools")
WAITING = ("hmcvt_core/diagnosis", "hmcvt_core/benches/transmission")
"""Folders that are not rewritten yet; one that is rewritten leaves this list."""


def texts(path):
    """Return the texts and comments of a module with their lines."""
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if token.type in TEXT:
                yield token.start[0], token.string


@pytest.mark.parametrize("package", PACKAGES)
def test_docstrings_and_messages_have_no_private_words(package):
    word = re.compile(rf"\b({SWEPT})\b", re.IGNORECASE)
    names = (path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py"))
    swept = [name for name in names if not name.as_posix().startswith(WAITING)]
    used = [
        f"{path}:{line}: {match[0]}"
        for path in swept
        for line, text in texts(ROOT / path)
        for match in word.finditer(text)
    ]
    assert used == []


def navigation():
    """Return the tabs of the web site with their pages, in their order."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    tabs = yaml.safe_load(text.partition("\nnav:")[2])
    return {name: item for tab in tabs for name, item in tab.items()}


@pytest.mark.parametrize("name", pages())
def test_page_has_no_private_words(name):
    text = prose((DOCS / name).read_text(encoding="utf-8"))
    used = {
        match.group(): better
        for pattern, better in PRIVATE_WORDS.items()
        for match in re.finditer(rf"\b({pattern})\b", text, re.IGNORECASE)
    }
    assert used == {}


@pytest.mark.parametrize("name", FRONT)
def test_front_page_is_short(name):
    words = (DOCS / name).read_text(encoding="utf-8").split()
    assert len(words) <= MAX_FRONT_WORDS


def test_front_pages_come_first():
    tabs = navigation()
    assert list(tabs) == SECTIONS
    guide = [page for item in tabs["User guide"] for page in item.values()]
    assert tuple(guide[1 : 1 + len(FRONT)]) == FRONT


def test_glossary_is_short():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ", text, re.MULTILINE)
    assert 0 < len(rows) - 1 <= MAX_TERMS

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""docs/tutorial.md from top to bottom, as its reader follows it; and examples of other pages."""

import re
import shlex
import shutil

import pytest

from .running import ROOT, write_raw_bench

pytestmark = pytest.mark.slow

DOCS = ROOT / "docs"
PAGE = (DOCS / "tutorial.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def blocks(page):
    """Indented blocks of a page, as lists of lines."""
    text = re.sub(r"```.*?```", "", page, flags=re.DOTALL)
    found = re.findall(r"(?:^    .*\n)+", text, flags=re.MULTILINE)
    return [[line[4:] for line in block.splitlines() if line.strip()] for block in found]


def same(shown, printed):
    """Whether a line is printed as it is shown; numbers may differ in the last digits."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(float(one) == pytest.approx(float(other), rel=0.02, abs=0.011)
               for one, other in pairs)


def follow(hmcvt, block, printed):
    """Run the commands of a block, or find what the block shows in what was printed last."""
    if block[0].startswith("pip install"):
        return printed  # what this test runs is installed, or is the checkout
    if block[0].startswith("cp "):
        _, source, target = block[0].split()
        shutil.copy(source, target)
        return printed
    if block[0].startswith("hmcvt "):
        assert len(block) == 1
        done = hmcvt(*shlex.split(block[0])[1:])
        assert (done.code, done.err) == (0, "")
        return done.out.splitlines()
    at = 0
    for line in block:
        found = [i for i in range(at, len(printed)) if same(line, printed[i])]
        assert found, (line, printed)
        at = found[0] + 1
    return printed


def test_every_step(hmcvt, tmp_path, monkeypatch):
    for folder in ("data", "params"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    write_raw_bench(tmp_path / "raw.csv")
    monkeypatch.chdir(tmp_path)
    printed, steps = [], blocks(PAGE)
    assert len(steps) >= 12
    for block in steps:
        printed = follow(hmcvt, block, printed)
    # The pictures of the page are those that its commands draw.
    pictures = set(re.findall(r"\(pictures/([\w.]+)\)", PAGE))
    assert pictures == {"fit.png", "map.png", "losses.png"}
    assert all((tmp_path / name).is_file() for name in pictures)
    assert (tmp_path / "report.html").is_file() and (tmp_path / "mine.yaml").is_file()


def test_worked_example_of_the_diagnosis(hmcvt, tmp_path, monkeypatch):
    page = (DOCS / "diagnosis.md").read_text(encoding="utf-8")
    example, = re.findall(r"^## A worked example$(.*?)^## ", page, re.DOTALL | re.MULTILINE)
    shutil.copytree(ROOT / "data", tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    printed, steps = [], blocks(example)
    assert len(steps) >= 6
    told = []
    for block in steps:
        printed = follow(hmcvt, block, printed)
        told += printed
    assert (tmp_path / "better.yaml").is_file()
    assert "model with charge_pump (50 %, not certain) written to better.yaml" in told


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda path: path.name)
def test_links_of_the_pages_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not re.match(r"https?://", target):
            assert (page.parent / target).exists(), target

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A real browser without a window, and what it measures on pages."""

import html
import json
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--enable-logging=stderr",
)
_SECONDS = 250

# Each page is put into a frame of the width to be tried; the frame around it measures.
_MEASURE = """
function crossing(a, b) {
  return Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
         Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
}
function measure(frame) {
  const page = frame.contentDocument, view = frame.contentWindow;
  const found = {width: view.innerWidth, scroll: page.documentElement.scrollWidth,
                 beyond: [], crossing: [], clipped: [], covered: [], smallest: 1e9, figures: 0};
  const answer = page.querySelector('.answer');
  found.answer = answer ? answer.getBoundingClientRect().bottom : 0;  // all else is folded
  for (const fold of page.querySelectorAll('details')) fold.open = true;
  for (const item of page.body.querySelectorAll('*')) {
    const box = item.getBoundingClientRect();
    if (box.width && box.right > view.innerWidth + 0.5 && !item.closest('.scroll'))
      found.beyond.push(item.tagName + ': ' + item.textContent.slice(0, 40));
  }
  for (const svg of page.querySelectorAll('svg[role=img]')) {
    found.figures += 1;
    const edge = svg.getBoundingClientRect();
    const texts = [...svg.querySelectorAll('text')];
    const boxes = texts.map(item => item.getBoundingClientRect());
    boxes.forEach((box, i) => {
      const size = parseFloat(view.getComputedStyle(texts[i]).fontSize) * svg.getScreenCTM().a;
      found.smallest = Math.min(found.smallest, size);
      const says = svg.id + ': ' + texts[i].textContent;
      if (box.left < edge.left - 0.5 || box.right > edge.right + 0.5 ||
          box.top < edge.top - 0.5 || box.bottom > edge.bottom + 0.5) found.clipped.push(says);
      const flag = (texts[i].closest('g') || texts[i]).getBoundingClientRect();  // with its box
      if (view.getComputedStyle(texts[i]).fontWeight === '700' && [...svg.querySelectorAll(
          '[data-test]')].some(mark => crossing(flag, mark.getBoundingClientRect())))
        found.covered.push(says);
      for (let j = 0; j < i; j++)
        if (crossing(box, boxes[j])) found.crossing.push(says + ' | ' + texts[j].textContent);
    });
  }
  return found;
}
window.onload = () => {
  const all = {};
  for (const frame of document.querySelectorAll('iframe')) all[frame.name] = measure(frame);
  document.querySelector('pre').textContent = JSON.stringify(all);
};
"""


def browse(body: str, scratch: Path) -> tuple[Any, list[str]]:
    """Load a page; return the JSON that its script leaves in <pre>, and lines of the console."""
    page = scratch / "around.html"
    page.write_text(f'<!DOCTYPE html><meta charset="utf-8">{body}', encoding="utf-8")
    program = next((found for name in _NAMES if (found := shutil.which(name))), None)
    if program is None:
        pytest.fail(
            "these tests look at the page in a real browser and found none: "
            "apt-get install chromium"
        )
    command = [
        program,
        *_FLAGS,
        f"--user-data-dir={scratch / 'profile'}",
        "--window-size=1400,2000",
        "--dump-dom",
        page.as_uri(),
    ]
    # A session of its own, so that its helpers end with it.
    browser = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        start_new_session=True,
    )
    try:
        document, errors = browser.communicate(timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(browser.pid, signal.SIGKILL)
        browser.communicate()
        pytest.fail(f"{program} did not load {page.name} in {_SECONDS} s")
    assert browser.returncode == 0, errors
    answer = re.search(r"<pre>(.+?)</pre>", document, re.DOTALL)
    assert answer is not None, "the script of the page gave nothing"
    return json.loads(html.unescape(answer[1])), [
        line for line in errors.splitlines() if "CONSOLE" in line
    ]


class Layout(NamedTuple):
    """What was measured, by `name@width`, and what the browser complained of meanwhile."""

    pages: dict[str, dict[str, Any]]
    console: list[str]


def laid_out(
    pages: Mapping[str, str], scratch: Path, widths: tuple[int, ...] = (1280, 390)
) -> Layout:
    """Lay pages out at widths, all in one browser."""
    frames = "".join(
        f'<iframe name="{name}@{width}" style="border:0;width:{width}px;height:2000px" '
        f'srcdoc="{html.escape(page)}"></iframe>'
        for name, page in pages.items()
        for width in widths
    )
    return Layout(
        *browse(f"<script>{_MEASURE}</script><body>{frames}<pre></pre></body>", scratch)
    )


def clicked(page: str, scratch: Path, script: str) -> dict[str, Any]:
    """Load a page, run the body of a function of its document `page`, return what that returns."""
    found: dict[str, Any] = browse(
        f'<iframe srcdoc="{html.escape(page)}"></iframe><pre></pre><script>window.onload = () => {{'
        " const page = document.querySelector('iframe').contentDocument;"
        " document.querySelector('pre').textContent = JSON.stringify((() => "
        f"{{ {script} }})()); }};</script>",
        scratch,
    )[0]
    return found

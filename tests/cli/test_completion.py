# SPDX-License-Identifier: Apache-2.0
"""Completion in a real bash, set up by the line of docs/cli.md."""

import os
import re
import shutil
import subprocess
import sys

import pytest

from .running import ROOT

BASH = shutil.which("bash")


@pytest.fixture
def environment(tmp_path):
    """A PATH on which `hmcvt` is the package under test."""
    command = tmp_path / "bin" / "hmcvt"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m hmcvt_core.cli "$@"\n')
    command.chmod(0o755)
    return {**os.environ, "PYTHONPATH": str(ROOT),
            "PATH": f"{command.parent}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.skipif(BASH is None, reason="needs bash")
@pytest.mark.parametrize(("words", "offered"), [
    (("hmcvt", "import-"), {"import-csv", "import-bag"}),
    (("hmcvt", "identify", "--formulation", ""), {"power_balance", "published"}),
    (("hmcvt", "optimum", "--ho"), {"--hold"}),
])
def test_bash_completes(environment, words, offered):
    page = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    line, = re.findall(r'^    (eval "\$\(_HMCVT_COMPLETE=bash_source hmcvt\)")', page, re.MULTILINE)
    quoted = " ".join(f"'{word}'" for word in words)
    # What bash does when the tab key is pressed: the words so far, then the function.
    script = f"""{line}
        COMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}
        function=$(complete -p hmcvt | sed 's/.*-F \\([^ ]*\\).*/\\1/')
        $function hmcvt "${{COMP_WORDS[COMP_CWORD]}}" ""
        printf '%s\\n' "${{COMPREPLY[@]}}" """
    done = subprocess.run([BASH, "--norc", "-c", script], env=environment, capture_output=True,
                          text=True, timeout=30)
    assert set(done.stdout.split()) == offered, done.stderr

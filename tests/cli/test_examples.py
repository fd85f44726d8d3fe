# SPDX-License-Identifier: Apache-2.0
"""Every example in --help and in docs/cli.md is a command that works."""

import re
import shlex
import shutil

import click
import pytest

from hmcvt_core.cli import COMMANDS, cli

from .running import ROOT

# The trial and the diagnosis take longer; what they print is tested with them.
PARSED_ONLY = ("blind", "diagnose", "fleet", "import-bag", "reproduce", "separable")


def _examples(text):
    """Command lines in a text, with the lines that a backslash continues."""
    joined = re.sub(r"\\\n\s*", " ", text)
    return [shlex.split(line.strip(), comments=True) for line in joined.splitlines()
            if re.match(r"\s+(\$ )?hmcvt [a-z]", line)]


def _command(name):
    return cli.get_command(click.Context(cli), name)


def _cases():
    cases = _examples((ROOT / "docs" / "cli.md").read_text(encoding="utf-8"))
    for name in COMMANDS:
        cases += _examples(_command(name).epilog or "")
    plain = {tuple(word for word in case if word != "$") for case in cases}
    return sorted(case[1:] for case in plain)


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder with what the examples name."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    shutil.copytree(ROOT / "params", tmp_path / "params")
    (tmp_path / "docs").mkdir()
    for name in ("bench.csv", "later.csv", "plan.csv"):
        shutil.copy(ROOT / "data" / "table2.csv", tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_shows_examples(name):
    command = _command(name)
    examples = _examples(command.epilog)
    assert examples
    assert all(case[:2] == ["hmcvt", name] for case in examples)
    assert command.help and all(
        option.help for option in command.params if isinstance(option, click.Option))


@pytest.mark.parametrize("case", _cases(), ids=" ".join)
def test_example(hmcvt, workplace, case):
    name, *arguments = case
    if name in PARSED_ONLY:
        _command(name).make_context(name, list(arguments))
        return
    done = hmcvt(*case)
    assert (done.code, done.err) == (0, "")
    assert done.out or "--out" in case
    if "--json" in case:
        assert done.json

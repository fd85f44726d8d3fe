# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every command shown to a reader works: in --help, in README.md and on every page of docs/.

A command line is run for real in a folder that holds the files it names. What is not run is named
in `PARSED_ONLY`, with the reason; its arguments are still read by the command it names. A line with
placeholders (`BENCH.csv`, `[--json]`), or that does no more than name an option, is a synopsis: the
command has to exist and have its options.
"""

import copy
import functools
import re
import shlex
import shutil

import click
import pytest
import yaml

from hmcvt_core.cli import cli

from .running import ROOT, write_raw_bench

PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
NAMES = cli.list_commands(click.Context(cli))
PARSED_ONLY = {
    "diagnose": "seconds each; run by test_tutorial.py, test_json.py and the Python of README.md",
    "fleet": "needs the logs of a fleet, or a Dask cluster; run by tests/fleet",
    "import-bag": "needs bags; run by tests/bag",
    "unit": "makers' tables are not copied here; run on simulated ones by tests/units",
    "node": "needs ROS and does not end; run by tests/ros/test_node_process.py",
}
SYNOPSIS = re.compile(r"\[|\b[A-Z]{3,}[A-Z_]*\b(?!\.md)|FILE|\.\.\.")


def _lines(text):
    """Command lines: those of code blocks, and those in the running text that have arguments."""
    joined = re.sub(r"\\\n\s*", " ", text)
    block = [line.strip().removeprefix("$ ") for line in joined.splitlines()
             if re.match(r"(    |\s+(\$ )?|\$ )hmcvt [a-z]", line)]
    inline = re.findall(r"`(hmcvt [a-z][a-z-]* [^`]+)`", re.sub(r"(?<!\n)\n(?!\n)", " ", text))
    return [re.sub(r"\s+#.*", "", line) for line in (*block, *inline)]


def _command(name):
    return cli.get_command(click.Context(cli), name)


@functools.cache
def _found():
    """Arguments of the command lines, and synopses, each once."""
    texts = [path.read_text(encoding="utf-8") for path in PAGES]
    texts += [_command(name).epilog or "" for name in NAMES]
    # An effect of one's own stays in the library for good: tests/cli/test_effects.py.
    lines = {line for text in texts for line in _lines(text) if "own_effect" not in line}
    synopses = {line for line in lines
                if SYNOPSIS.search(line) or re.fullmatch(r"hmcvt [a-z-]+ --[a-z]+", line)}
    cases = {tuple(shlex.split(line)[1:]) for line in lines - synopses}
    return sorted(cases), sorted(synopses)


CASES, SYNOPSES = _found()


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A folder with what the examples name."""
    shutil.copytree(ROOT / "data", tmp_path / "data")
    shutil.copytree(ROOT / "params", tmp_path / "params")
    (tmp_path / "docs").mkdir()
    write_raw_bench(tmp_path / "raw.csv")
    shutil.copy(ROOT / "data" / "simulated.csv", tmp_path / "bench.csv")
    for name in ("later.csv", "plan.csv", "my_bench.csv", "samples.csv"):
        shutil.copy(ROOT / "data" / "table2.csv", tmp_path / name)
    for name in ("mine.yaml", "served.yaml"):
        shutil.copy(ROOT / "params" / "hm4.yaml", tmp_path / name)
    train = yaml.safe_load((ROOT / "params" / "transmission.yaml").read_text(encoding="utf-8"))
    train["stages"]["HM2"] = copy.deepcopy(train["stages"]["HM4"])  # an alias would be refused
    (tmp_path / "my_transmission.yaml").write_text(yaml.safe_dump(train), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", NAMES)
def test_every_command_shows_examples(name):
    command = _command(name)
    examples = [shlex.split(line) for line in _lines(command.epilog)]
    assert examples
    # The older name of import shows the new one.
    assert all(case[:2] == ["hmcvt", name.removesuffix("-csv")] for case in examples)
    assert command.help and all(
        option.help for option in command.params if isinstance(option, click.Option))


def test_every_command_stands_in_cli_md_and_has_an_example():
    table = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
    for name in NAMES:
        assert re.search(rf"^\| `hmcvt {name}\b", table, re.MULTILINE), name
        assert any(case[0] == name.removesuffix("-csv") for case in CASES), name


@pytest.mark.parametrize("case", CASES, ids=" ".join)
def test_example(hmcvt, workplace, case):
    name, *arguments = case
    if name in PARSED_ONLY:
        _command(name).make_context(name, list(arguments))
        return
    done = hmcvt(*case)
    assert (done.code, done.err) == (0, "")
    assert done.out or "--out" in case
    for option in ("--out", "--picture", "--report", "--save-model"):
        if option in case:
            assert (workplace / case[case.index(option) + 1]).stat().st_size > 0
    if "--json" in case:
        assert done.json


@pytest.mark.parametrize("line", SYNOPSES)
def test_synopsis(line):
    name = line.split()[1]
    known = {option for parameter in _command(name).params for option in parameter.opts}
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", line))
    assert named - {"--ros-args"} <= known


def test_python_of_the_readme(workplace):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    assert blocks
    names = {}
    for block in blocks:
        exec(block, names)
    assert 0.0 < names["fit"].fit_error < 0.05 and names["found"].verdict

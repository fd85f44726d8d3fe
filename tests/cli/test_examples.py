# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every command shown to a reader works: in --help, in README.md and on every page of docs/.

The tutorial and the worked example of the diagnosis also print what the pages show. A command
line is run in a folder that holds the files it names. Commands that are not run are listed in
`PARSED_ONLY` with the reason; their arguments are parsed. A line with placeholders (`BENCH.csv`,
`[--json]`), or that only names an option, is a synopsis: the command has to exist and have its
options. Lines of other programs are checked as far as this project defines them; `EXTERNAL` lists
the rest. The Python of the pages is run.
"""

import contextlib
import copy
import functools
import io
import itertools
import re
import runpy
import shlex
import shutil
import sys
import tempfile
from pathlib import Path

import click
import numpy as np
import pytest
import yaml
from logs import recordings

from hmcvt_core import EfficiencyModel, HydraulicParameters, save_model
from hmcvt_core.model.parameter_file import load_stages
from hmcvt_tools.cli.commands import cli
from studies.road.bus import MAKER, Faults, encode, write_trace
from studies.road.drive import drive, machine_of
from studies.road.scoring import well_known

from .running import ROOT, run, script, write_raw_bench

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("coarse_maps")]

DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md")))
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
NAMES = cli.list_commands(click.Context(cli))
PARSED_ONLY = {
    "import-bag": "needs bags; run by tests/bag/test_command.py",
    "node": "needs ROS and does not end; run by tests/ros/test_node_process.py",
    "transmission new": "asks questions; run by tests/cli/test_transmission.py",
    "--scheduler": "needs a Dask cluster; run by tests/fleet/test_cluster.py",
}
RUN_BY_TEST_LONG = (
    "study",
    "unit",
    "diagnose stages.csv",
    "diagnose bench.csv --baseline",
    "diagnose bench.csv --holdout",
    "diagnose bench.csv --noise",
    "diagnose bench.csv --params",
    "diagnose data/simulated.csv --noise",
    "diagnose data/simulated.csv --report",
    "diagnose data/simulated.csv --save-model",
    "diagnose-system examples/electric_drive.py:system data/electric_drive.csv --noise",
    "estimate season",
    "fleet",
    "next stages.csv",
)
"""Beginnings of command lines that `make test` only parses: other tests run what they run."""
REPEATED = (
    "diagnose data/simulated.csv --json > before.json",
    "diagnose data/simulated.csv --picture gap.png",
    "diagnose data/table2.csv",
    "diagnose data/table2.csv --noise 0.0085",
    "mission ploughing --bound",
    "mission transport --strategy engine_line --compare --report mission.html",
    "next bench.csv --noise 0.004",
    "next data/simulated.csv",
)
"""Whole lines of the same kind: another line has these options and more."""
LONG_PAGES = ("api-diagnosis.md", "gallery.md", "mission.md")
"""Pages whose Python takes seconds to half a minute; other tests run what it runs."""
EXTERNAL = {
    "colcon": "builds a ROS workspace: make colcon",
    "cp": "part of the tutorial, which is run",
    "dask": "starts a cluster: tests/fleet/test_cluster.py",
    "docker": "needs a container runtime",
    "eval": "a shell's completion",
    "export": "a shell's variables",
    "hmcvt-node": "does not end: tests/ros/test_node_process.py",
    "ros2": "needs an installation of ROS 2",
    "rosdep": "needs an installation of ROS 2",
    "source": "needs an installation of ROS 2",
    "sudo": "installs system packages",
}
FEWER_LOGS = 2
SYNOPSIS = re.compile(r"\[|\b[A-Z]{3,}[A-Z_]*\b(?!\.md)|FILE|\.\.\.")


def _lines(text):
    """Return the command lines in code blocks, and those with arguments in the text."""
    joined = re.sub(r"\\\n\s*", " ", text)
    block = [
        line.strip().removeprefix("$ ")
        for line in joined.splitlines()
        if re.match(r"(    |\s+(\$ )?|\$ )hmcvt [a-z]", line)
    ]
    inline = re.findall(
        r"`(hmcvt [a-z][a-z-]* [^`]+)`", re.sub(r"(?<!\n)\n(?!\n)", " ", text)
    )
    return [re.sub(r"\s+#.*", "", line) for line in (*block, *inline)]


def _command(name):
    return cli.get_command(click.Context(cli), name)


def _with_subcommands(command):
    """Return a command, and those of it where it is a group."""
    return [command, *getattr(command, "commands", {}).values()]


def _is_parsed_only(case):
    """Return whether a command line is not run: see PARSED_ONLY."""
    asks = case[:2] == ("transmission", "new") and len(case) == 3
    return asks or not PARSED_ONLY.keys().isdisjoint(case)


@functools.cache
def _cases_and_synopses():
    """Return the arguments of the command lines, and the synopses, without duplicates."""
    texts = [path.read_text(encoding="utf-8") for path in PAGES]
    for name in NAMES:
        texts += [each.epilog or "" for each in _with_subcommands(_command(name))]
    # A loaded effect stays in the library: tests/cli/test_effects.py runs these.
    lines = {
        line for text in texts for line in _lines(text) if "own_effect" not in line
    }
    synopses = {
        line
        for line in lines
        if SYNOPSIS.search(line) or re.fullmatch(r"hmcvt [a-z-]+ --[a-z]+", line)
    }
    cases = {tuple(shlex.split(line)[1:]) for line in lines - synopses}
    return sorted(cases), sorted(synopses)


CASES, SYNOPSES = _cases_and_synopses()


def blocks(page):
    """Return the indented blocks of a page, as lists of lines."""
    text = re.sub(r"```.*?```", "", page, flags=re.DOTALL)
    texts = re.findall(r"(?:^    .*\n)+", text, flags=re.MULTILINE)
    return [
        [line[4:] for line in block.splitlines() if line.strip()] for block in texts
    ]


def _worked_example():
    """Return the part of the page on the diagnosis that a test follows."""
    page = (DOCS / "diagnosis.md").read_text(encoding="utf-8")
    (example,) = re.findall(
        r"^## A worked example$(.*?)^## ", page, re.DOTALL | re.MULTILINE
    )
    return example


def _followed_cases():
    """Return the arguments of the command lines that tests of whole pages run."""
    pages = [_worked_example()]
    for name in ("tutorial.md", "predict.md"):
        pages.append((DOCS / name).read_text(encoding="utf-8"))
    first_lines = [block[0] for page in pages for block in blocks(page)]
    commands = [line for line in first_lines if line.startswith("hmcvt ")]
    return {tuple(shlex.split(line)[1:]) for line in commands}


FOLLOWED = _followed_cases()


@pytest.fixture
def workplace(prepared, tmp_path, monkeypatch):
    """Return a folder with the files that the examples name."""
    shutil.copytree(prepared, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Return a folder with the files that the examples name, to be copied."""
    folder = tmp_path_factory.mktemp("prepared")
    shutil.copytree(ROOT / "data", folder / "data")
    shutil.copytree(ROOT / "params", folder / "params")
    (folder / "docs").mkdir()
    (folder / "examples").mkdir()
    shutil.copy(ROOT / "examples" / "electric_drive.py", folder / "examples")
    write_raw_bench(folder / "raw.csv")
    _write_logs(folder)
    for name in (
        "pump",
        "commissioning",
        "pump_asw062",
        "motors_s4d_c7",
        "table",
    ):
        _write_unit(folder / f"{name}.csv")
    sound = (ROOT / "data" / "simulated.csv").read_text(encoding="utf-8").splitlines()
    (folder / "commissioned.csv").write_text("\n".join(sound[:49]), encoding="utf-8")
    rows = (ROOT / "data" / "simulated.csv").read_text().replace("\n", ",HM4\n")
    (folder / "bench.csv").write_text(rows.replace("HM4", "stage", 1))
    for name in ("later.csv", "plan.csv", "my_bench.csv", "samples.csv"):
        shutil.copy(ROOT / "data" / "table2.csv", folder / name)
    for name in ("mine.yaml", "served.yaml"):
        shutil.copy(ROOT / "params" / "hm4.yaml", folder / name)
    train = yaml.safe_load(
        (ROOT / "params" / "transmission.yaml").read_text(encoding="utf-8")
    )
    train["stages"]["HM2"] = copy.deepcopy(
        train["stages"]["HM4"]
    )  # an alias would be refused
    rows = "".join(f"{i},8,{20 + i % 3}\n" for i in range(20))
    header = "time,ground_speed [km/h],drawbar_force [kN]\n"
    (folder / "my_cycle.csv").write_text(header + rows)
    (folder / "my_strategy.py").write_text(
        "def choose(now):\n    return now.choice(now.reachable.argmin())\n"
    )
    (folder / "my_transmission.yaml").write_text(
        yaml.safe_dump(train), encoding="utf-8"
    )
    _write_stages(folder)
    for name, content in _machine_logs().items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
    _write_maps(folder)
    return folder


def _write_maps(folder):
    """Write the loss map of a gearbox, and a matrix of efficiencies."""
    losses = ["Input Speed [rpm],Input Torque [Nm],Torque Loss [Nm]"]
    for speed, torque in itertools.product((500, 1500, 2500), (100, 300, 900)):
        losses.append(f"{speed},{torque},{8.5 + 0.02 * torque + 0.001 * speed:.4f}")
    (folder / "gear.vtlm").write_text("\n".join(losses), encoding="utf-8")
    matrix = ["torque,500,1500,2500", "100,88,89,87", "300,92,93,91", "900,90,91,90"]
    (folder / "matrix.csv").write_text("\n".join(matrix), encoding="utf-8")


def _write_stages(folder):
    """Write what the commands of docs/table-to-decision.md write one after the other."""
    page = (DOCS / "table-to-decision.md").read_text(encoding="utf-8")
    lines = [line for line in _lines(page) if "--gear-pair" in line or "--yes" in line]
    gears = folder / "stages.yaml"
    for line in lines:
        text = line.replace("stages.yaml", str(gears))
        text = text.replace("stages.csv --yes", f"{folder / 'stages.csv'} --yes")
        words = text.replace("data/three", f"{ROOT}/data/three")
        assert run(*shlex.split(words)[1:]).code == 0
    stages = load_stages(gears)
    parameters = HydraulicParameters(9e-12, 0.072, 0.129)
    model = EfficiencyModel(stages[0], parameters, other_stages=tuple(stages[1:]))
    save_model(model, folder / "stages_model.yaml")


@functools.cache
def _machine_logs():
    """Return the logs of machines that the pages name, by path."""
    time, columns = recordings.recorded()
    rng = np.random.default_rng(3)
    machine = machine_of(well_known(), rng)
    messages = encode(
        drive(machine, 12.0, rng), machine, Faults(0.0, (0.0, 0.0, 0.0, 0.0)), True
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings.write_mdf(folder / "test.mf4", time, columns)
        recordings.write_dbc(folder / "bench.dbc")
        recordings.write_can(folder / "bus.blf", time, columns)
        recordings.write_drive(folder / "drive.mf4")
        write_trace(folder / "drive.blf", messages)
        write_trace(folder / "drive.log", messages)
        logs = {path.name: path.read_bytes() for path in folder.iterdir()}
    logs["season/1.blf"] = logs["season/2.blf"] = logs["drive.blf"]
    logs["maker.dbc"] = MAKER.encode()
    logs["daq.yaml"] = DAQ.encode()
    return logs


DAQ = """kind: hmcvt table mapping
columns:
  engine_speed: n_engine:rpm
  engine_torque: M_engine:N m
  output_speed: n_output:rpm
  output_torque: M_output:N m
  displacement_ratio: PumpStroke:%
"""


def _write_logs(folder):
    """Write two short logs where the pages have a fleet."""
    lines = (ROOT / "data" / "simulated.csv").read_text().splitlines()
    for logs in (folder / "logs", folder / "fleet" / "logs"):
        logs.mkdir(parents=True)
        for number in range(FEWER_LOGS):
            part = lines[1 + 40 * number : 41 + 40 * number]
            (logs / f"{number}.csv").write_text("\n".join([lines[0], *part, ""]))


def _write_unit(path):
    """Write the table of a simulated unit that leaks in proportion to speed as well."""
    speed, pressure = map(
        np.ravel, np.meshgrid(np.linspace(50.0, 270.0, 8), np.linspace(4e6, 4e7, 8))
    )
    volume = 11.3e-6
    flow = 3e-12 * pressure + 2e-9 * volume * pressure * speed
    torque = 0.05 * speed + 0.012 * volume * pressure
    rng = np.random.default_rng(0)
    columns = {
        "displacement": np.full(speed.shape, volume),
        "speed": speed,
        "pressure": pressure,
        "flow_loss": flow + 1e-6 * rng.standard_normal(speed.shape),
        "torque_loss": torque + 0.1 * rng.standard_normal(speed.shape),
    }
    kind = "motor" if path.stem in ("motors_s4d_c7", "table") else "pump"
    head = ",".join([*columns, "kind", "unit"])
    rows = [
        ",".join(f"{value:.6g}" for value in row) + f",{kind},S4D"
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join([head, *rows, ""]))


@pytest.mark.parametrize("name", NAMES)
def test_every_command_shows_examples(name):
    command = _command(name)
    examples = [shlex.split(line) for line in _lines(command.epilog)]
    assert examples
    # The older name of import shows the new one.
    assert all(case[:2] == ["hmcvt", name.removesuffix("-csv")] for case in examples)
    assert command.help and all(
        option.help for option in command.params if isinstance(option, click.Option)
    )


def test_cli_page_lists_every_command():
    table = (DOCS / "cli.md").read_text(encoding="utf-8")
    for name in NAMES:
        assert re.search(rf"^\| `hmcvt {name}\b", table, re.MULTILINE), name
        assert any(case[0] == name.removesuffix("-csv") for case in CASES), name


def _skip_without_tools_for_an_fmu():
    pytest.importorskip("fmpy", reason="needs the extra export")
    if not any(shutil.which(name) for name in ("cc", "gcc", "clang")):
        pytest.skip("no C compiler")


def _is_long(case):
    line = " ".join(case)
    return line.startswith(RUN_BY_TEST_LONG) or line in REPEATED


def _marked(item, is_long):
    return pytest.param(item, marks=[pytest.mark.long] if is_long else [])


@pytest.mark.parametrize("case", list(filter(_is_long, CASES)), ids=" ".join)
def test_long_example_is_parsed(workplace, case):
    name, *arguments = _without_redirection(case)
    _command(name).make_context(name, list(arguments))


@pytest.mark.parametrize(
    "case",
    [_marked(case, _is_long(case)) for case in CASES if case not in FOLLOWED],
    ids=" ".join,
)
def test_example(hmcvt, workplace, case):
    name, *arguments = case
    if "fmu" in case:
        _skip_without_tools_for_an_fmu()
    if _is_parsed_only(case):
        _command(name).make_context(name, list(arguments))
        return
    if case[:2] == ("transmission", "new"):  # it never replaces a file
        (workplace / case[2]).unlink(missing_ok=True)
    done = hmcvt(*_without_redirection(case))
    assert done.code == 0, done.err
    for line in done.err.splitlines():
        # What takes more than two seconds reports its progress there.
        assert name == "fleet" or line.startswith("study: ")
    assert done.out or "--out" in case
    if "--json" in case:
        assert done.json
    for path in _written(case):
        assert (workplace / path).stat().st_size > 0


def _without_redirection(case):
    """Return the arguments without a file to which a shell would write the output."""
    return case[: case.index(">")] if ">" in case else case


def _written(case):
    """Return the files and folders that a command is to write."""
    options = ("--out", "--picture", "--report", "--save-model")
    return [case[case.index(option) + 1] for option in options if option in case]


@pytest.mark.parametrize("line", SYNOPSES)
def test_synopsis(line):
    name = line.split()[1]
    known = set()
    for command in _with_subcommands(_command(name)):
        for parameter in command.params:
            known.update(parameter.opts)
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", line))
    assert named - {"--ros-args"} <= known


def _shell_lines():
    """Lines in code blocks that run another program than hmcvt, each once."""
    names = {"make", "pip", "python", *EXTERNAL}
    lines = set()
    for path in PAGES:
        joined = re.sub(r"\\\n\s*", " ", path.read_text(encoding="utf-8"))
        for line in joined.splitlines():
            words = line.split()
            if line.startswith("    ") and words and words[0] in names:
                lines.add(line.partition("  #")[0].strip())
        for line in re.findall(r"`(make [^`]+)`", path.read_text(encoding="utf-8")):
            lines.add(line)
    assignments = {line for line in lines if " = " in line}
    return sorted(lines - assignments)


@pytest.mark.parametrize("line", _shell_lines())
def test_line_of_another_program(line):
    program, *words = shlex.split(line)
    if program == "make":
        _check_targets(words)
    elif program == "pip":
        _check_extras(line)
    elif program == "python" and words[0] == "-m":
        _check_study(words[1], words[2:])
    elif program == "python":
        _check_script(words[0])


def _check_targets(words):
    """Check that the Makefile has the targets."""
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in (word for word in words if "=" not in word):
        assert re.search(rf"^{target}:", rules, re.MULTILINE), target


def _check_extras(line):
    """Check that the project has the extras."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for extra in re.findall(r"\[(\w+)\]", line):
        assert re.search(rf"^{extra} = ", project, re.MULTILINE), extra


def _check_script(name):
    """Check that the script exists and that a test names it."""
    path = ROOT / name
    assert path.is_file(), name
    tests = [test.read_text("utf-8") for test in (ROOT / "tests").rglob("*.py")]
    assert any(path.stem in text for text in tests), f"no test runs {name}"


def _check_study(module, words):
    """Check that the module exists and has the options."""
    if not module.startswith("studies"):
        return
    shown = _help_of(module)
    for option in (word for word in words if word.startswith("--")):
        assert option in shown, option


@functools.cache
def _help_of(module):
    """Return what `python -m MODULE --help` prints."""
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(io.StringIO()) as out,
        pytest.raises(SystemExit) as ended,
    ):
        patch.setattr(sys, "argv", [module, "--help"])
        for name in (module, f"{module}.__main__"):  # as a fresh Python has them
            patch.delitem(sys.modules, name, raising=False)
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    assert not ended.value.code
    return out.getvalue()


def _pages_with_python():
    """Pages whose Python examples run from beginning to end, without a node."""
    pages = []
    for path in sorted(DOCS.rglob("*.md")):
        if path.name == "node.md":  # run by tests/ros/test_node_docs.py
            continue
        if "import hmcvt_core as hmcvt\n" in "".join(_python(path)):
            pages.append(path)
    return [*pages, DOCS / "api-effects.md"]


def _python(path):
    return re.findall(r"```python\n(.*?)```", path.read_text("utf-8"), re.DOTALL)


@pytest.mark.parametrize(
    "path",
    [_marked(path, path.name in LONG_PAGES) for path in _pages_with_python()],
    ids=lambda path: path.name,
)
def test_python_of_a_page(workplace, path):
    if path.name == "export.md":
        _skip_without_tools_for_an_fmu()
    program = "\n".join(_python(path))
    if "Effect)" in program:  # its class would stay in the library
        (workplace / "page.py").write_text(program, encoding="utf-8")
        done = script(workplace / "page.py", cwd=workplace)
        assert done.returncode == 0, done.stderr
    else:
        exec(compile(program, path.name, "exec"), {"__name__": "__main__"})
    for name in re.findall(r'savefig\("([\w.-]+)"', program):
        assert (workplace / name).is_file() and (DOCS / "pictures" / name).is_file()


def test_python_of_the_readme(workplace):
    blocks = re.findall(
        r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL
    )
    assert blocks
    names = {}
    for block in blocks:
        exec(block, names)
    assert 0.0 < names["fit"].fit_error < 0.05 and names["diagnosis"].verdict


def same(shown, printed):
    """Return whether a line is printed as shown; numbers may differ in the last digits."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(
        float(one) == pytest.approx(float(other), rel=0.02, abs=0.011)
        for one, other in pairs
    )


def follow(hmcvt, block, printed):
    """Run the command of a block, or look for the lines of the block in the last output."""
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
        matches = [i for i in range(at, len(printed)) if same(line, printed[i])]
        assert matches, (line, printed)
        at = matches[0] + 1
    return printed


def followed(hmcvt, page, least):
    """Follow all blocks of a page; return everything that was printed."""
    steps = blocks(page)
    assert len(steps) >= least
    printed = []
    output = []
    for block in steps:
        printed = follow(hmcvt, block, printed)
        output += printed
    return output


def test_tutorial(hmcvt, workplace):
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    (workplace / "mine.yaml").unlink()
    followed(hmcvt, page, 12)
    # The pictures of the page are those that its commands draw.
    pictures = set(re.findall(r"\(pictures/([\w.]+)\)", page))
    assert pictures == {"fit.png", "map.png", "losses.png"}
    assert all(
        (workplace / name).is_file() for name in (*pictures, "report.html", "mine.yaml")
    )


def test_page_on_predictions(hmcvt, workplace):
    page = (DOCS / "predict.md").read_text(encoding="utf-8")
    followed(hmcvt, page, 15)


def test_clutches_on_the_page_on_transmissions(hmcvt, workplace):
    page = (DOCS / "add-a-transmission.md").read_text(encoding="utf-8")
    (command,) = [line for line in _lines(page) if '--clutch "CR' in line]
    (table,) = [block for block in blocks(page) if "open clutch" in block[0]]
    printed = hmcvt(*shlex.split(command)[1:])
    follow(hmcvt, table, printed.out.splitlines())
    checked = hmcvt("transmission", "check", "gears.yaml")
    follow(hmcvt, table, checked.out.splitlines())


def test_fuel_in_the_readme(hmcvt, workplace):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    bounded = hmcvt("mission", "ploughing", "--bound").out  # of strategy causal
    printed = [bounded]
    for strategy in ("engine_line", "fixed_speed"):
        printed.append(hmcvt("mission", "ploughing", "--strategy", strategy).out)
    litres = [re.search(r"\(([\d.]+) l\)", text)[1] for text in printed]
    assert re.findall(r"^\| .* \| ([\d.]+) l \|$", readme, re.MULTILINE) == litres
    (above,) = re.findall(r"is ([\d.]+) % above the least fuel", readme)
    assert f"the strategy is {above} % above the best possible" in bounded
    engine, drawbar = re.search(
        r"engine ([\d.]+) kWh, drawbar ([\d.]+) kWh", readme
    ).groups()
    assert f"engine work {engine} kWh" in bounded
    assert re.search(rf"drawbar +{drawbar}\d* kWh", bounded)


def test_worked_example_of_the_diagnosis(hmcvt, workplace):
    output = followed(hmcvt, _worked_example(), 6)
    assert (workplace / "better.yaml").is_file()
    assert (
        "model with charge pump (0.90 -> 0.50 points rms at held-out samples) written to "
        "better.yaml"
    ) in output


@pytest.mark.parametrize("page", sorted(DOCS.rglob("*.md")), ids=lambda path: path.name)
def test_links_of_the_pages_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not re.match(r"https?://", target):
            assert (page.parent / target).exists(), target

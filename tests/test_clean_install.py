# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An empty environment: the core with its three libraries, the README line by line, and the node.

Needs an index of packages; `make test-long` runs it.
"""

import json
import re
import shlex
import shutil
import signal
import subprocess
import sys

import pytest
from cli.running import ROOT

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]

README = (ROOT / "README.md").read_text(encoding="utf-8")
NODE_PAGE = (ROOT / "docs" / "node.md").read_text(encoding="utf-8")
CORE = {"hmcvt_ros", "numpy", "pyyaml", "scipy"}


def readme_steps():
    """Return what the README installs first, and its Python and commands after that.

    The node does not end; tests/ros/test_node_process.py runs it.
    """
    _, line, rest = re.split(
        r'^    (pip install "?\..*)$', README, maxsplit=1, flags=re.MULTILINE
    )
    python = re.findall(r"```python\n(.*?)```", rest, re.DOTALL)
    lines = re.findall(r"^    (hmcvt .*)$", rest, re.MULTILINE)
    commands = [shlex.split(line, comments=True) for line in lines]
    return (
        shlex.split(line, comments=True)[2],
        python,
        [words for words in commands if words[:2] != ["hmcvt", "node"]],
    )


class Environment:
    """An empty virtual environment, a copy of the checkout, and a folder to work in.

    Args:
        folder: for all three.

    Attributes:
        sourced: further environment variables of its programs.
    """

    def __init__(self, folder):
        self.source = folder / "source"
        ignored = shutil.ignore_patterns(
            ".*", "__pycache__", "build", "dist", "site", "reproduction", "*.egg-info"
        )
        shutil.copytree(ROOT, self.source, ignore=ignored)
        # The installed package, not the checkout, is imported there.
        self.work = folder / "work"
        for name in ("data", "params"):
            shutil.copytree(ROOT / name, self.work / name)
        self.bin = folder / "venv" / "bin"
        self.sourced = {}
        subprocess.run(
            [sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True
        )

    @property
    def variables(self):
        """Environment variables of its programs; nodes talk to those of this machine alone."""
        return {
            "PATH": f"{self.bin}:/usr/bin:/bin",
            "HOME": str(self.work),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": "98",
            **self.sourced,
        }

    def pip(self, *arguments):
        """Run pip of this Python on the environment, in the copy of the checkout."""
        command = [sys.executable, "-m", "pip", "--python", self.bin / "python"]
        return self.run(
            *command, "--disable-pip-version-check", *arguments, folder=self.source
        )

    def run(self, *command, folder=None):
        """Run a program with nothing but the environment on its path."""
        done = subprocess.run(
            command,
            cwd=folder or self.work,
            env=self.variables,
            capture_output=True,
            text=True,
            timeout=900,
        )
        return done.returncode, done.stdout, done.stderr

    def install(self, what):
        """Install the copy, not editable, with the locked versions."""
        code, _, errors = self.pip(
            "install", "--quiet", "--constraint", "constraints.txt", what
        )
        assert code == 0, errors


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    made = Environment(tmp_path_factory.mktemp("clean"))
    made.install(".")
    return made


@pytest.fixture(scope="module")
def with_readme_extras(environment):
    """The environment after the install line of the README; comes after the tests of the core."""
    environment.install(readme_steps()[0])
    return environment


def test_the_core_brings_three_libraries(environment):
    code, listed, errors = environment.pip("list", "--format", "json")
    assert code == 0, errors
    names = {entry["name"].lower().replace("-", "_") for entry in json.loads(listed)}
    assert names == CORE


def test_the_core_identifies_and_diagnoses(environment):
    program = """
import hmcvt_core as hmcvt
samples = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
fit = hmcvt.identify(samples)
print(hmcvt.__file__, hmcvt.diagnose(fit.model, samples).verdict)
"""
    code, printed, errors = environment.run(
        environment.bin / "python", "-W", "error", "-c", program
    )
    assert (code, errors) == (0, "")
    assert "site-packages" in printed


def test_the_command_says_what_to_install(environment):
    code, printed, errors = environment.run(environment.bin / "hmcvt", "--help")
    assert (code, printed) == (2, "")
    assert errors.count("\n") == 1 and 'pip install ".[tools]"' in errors


def test_every_line_of_the_readme_after_its_install_line(with_readme_extras):
    _, python, commands = readme_steps()
    assert len(python) == 1 and len(commands) >= 5
    bin_folder = with_readme_extras.bin
    done = with_readme_extras.run(bin_folder / "python", "-W", "error", "-c", python[0])
    assert done[0] == 0, done
    for command in commands:
        done = with_readme_extras.run(bin_folder / "hmcvt", *command[1:])
        assert done[0] == 0, (command, done)
    assert (with_readme_extras.work / "report.html").is_file()
    assert (with_readme_extras.work / "controller" / "hmcvt_model.c").is_file()


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """Build the wheel and the source archive of a copy of the checkout."""
    made = Environment(tmp_path_factory.mktemp("dist"))
    build = "import setuptools.build_meta as b; b.build_sdist('dist'); b.build_wheel('dist')"
    code, _, errors = made.run(sys.executable, "-c", build, folder=made.source)
    assert code == 0, errors
    return made.source / "dist"


@pytest.mark.parametrize("kind", ["*.whl", "*.tar.gz"])
def test_a_built_distribution_works_in_an_empty_environment(
    distributions, kind, tmp_path
):
    made = Environment(tmp_path)
    (archive,) = distributions.glob(kind)
    made.install(f"hmcvt_ros[tools] @ {archive.as_uri()}")
    code, out, errors = made.run(made.bin / "hmcvt", "--version")
    assert code == 0, errors
    assert archive.name.startswith(f"hmcvt_ros-{out.split()[-1]}")
    code, out, errors = made.run(
        made.bin / "hmcvt", "identify", "data/table2.csv", "--fit", "1,2,4-6", "--json"
    )
    assert code == 0, errors
    assert json.loads(out)["parameters"]["leakage"]["value"] > 0.0


def refitted_and_diagnosed(made, *node):
    """Run a node and the first program of its page; return the files of its state folder.

    Args:
        made: environment of both.
        node: command of the node.
    """
    shutil.copytree(ROOT / "examples", made.work / "examples")
    (program,) = re.findall(r"```python\n(import rclpy\n.*?)```", NODE_PAGE, re.DOTALL)
    (made.work / "try_node.py").write_text(program)
    state = made.work / ".ros" / "hmcvt"
    log = made.work / "node.log"
    with log.open("w") as stream:
        process = subprocess.Popen(
            node, cwd=made.work, env=made.variables, stdout=stream, stderr=stream
        )
    try:
        code, printed, errors = made.run(made.bin / "python", "try_node.py")
        assert code == 0, (errors, log.read_text())
        assert printed.splitlines()[2] == "no_gap"
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=30) == 0, log.read_text()
    finally:
        process.kill()
        process.wait()
    return {str(path.relative_to(state)) for path in state.rglob("*.*")}


@pytest.mark.parametrize("extras", ["ros", "ros,report"])
def test_node_refits_and_diagnoses_after_pip(extras, tmp_path):
    made = Environment(tmp_path)
    assert f'pip install ".[{extras}]"' in (ROOT / "docs" / "deploy.md").read_text()
    made.install(f".[{extras}]")
    files = refitted_and_diagnosed(made, made.bin / "hmcvt-node")
    assert {"models/0001.yaml", "reports/0001.json"} <= files
    assert ("reports/0001.html" in files) == ("report" in extras)


def test_node_refits_and_diagnoses_after_colcon(tmp_path):
    """With rclpy from wheels in place of /opt/ros/jazzy, and nothing of hmcvt from pip."""
    made = Environment(tmp_path)
    made.install(".[ros]")
    for arguments in (
        ("uninstall", "--yes", "hmcvt_ros"),
        ("install", "--quiet", "setuptools<80", "colcon-common-extensions"),
    ):
        code, _, errors = made.pip(*arguments)
        assert code == 0, errors
    code, _, errors = made.run(made.bin / "colcon", "build", folder=made.source)
    assert code == 0, errors
    setup = made.source / "install" / "setup.sh"
    node = (
        made.source / "install" / "hmcvt_ros" / "lib" / "hmcvt_ros" / "efficiency_node"
    )
    # As `source install/setup.bash` in both terminals.
    code, sourced, errors = made.run(
        "sh",
        "-c",
        f"COLCON_CURRENT_PREFIX={setup.parent} . {setup} && echo $PYTHONPATH",
    )
    assert code == 0, errors
    made.sourced["PYTHONPATH"] = sourced.strip()
    program = (
        "import hmcvt_ros, hmcvt_core; print(hmcvt_ros.__file__, hmcvt_core.__file__)"
    )
    _, printed, _ = made.run(made.bin / "python", "-c", program)
    assert printed.count(str(made.source / "install")) == 2, printed
    files = refitted_and_diagnosed(made, node)
    assert {"models/0001.yaml", "reports/0001.json"} <= files

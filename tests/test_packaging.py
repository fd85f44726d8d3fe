# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Metadata, dependencies, shipped files and licence of the package."""

import ast
import configparser
import re
import shutil
import subprocess
import sys
import tarfile
import xml.etree.ElementTree as ElementTree
from importlib.metadata import version

import pytest
import yaml
from cli.running import ROOT

import hmcvt_core as hmcvt

PACKAGE = ElementTree.parse(ROOT / "package.xml").getroot()
# What rosdep calls the packages that Python imports under another name.
KEYS = {
    name: f"python3-{name}"
    for name in (
        "click",
        "hypothesis",
        "jinja2",
        "matplotlib",
        "numpy",
        "pandas",
        "pint",
        "pytest",
        "scipy",
        "yaml",
    )
} | {"nptdms": "npTDMS"}


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_package_xml_repeats_name_and_version():
    assert PACKAGE.findtext("name") == "hmcvt_ros"
    assert PACKAGE.findtext("version") == hmcvt.__version__ == version("hmcvt_ros")
    # ROS finds an ament_python package by an empty marker of its name.
    assert (
        ROOT / "hmcvt_ros" / "resource" / PACKAGE.findtext("name")
    ).read_bytes() == b""


@pytest.mark.parametrize("folder", ["data", "params"])
def test_every_shipped_file_is_found(folder):
    files = [path for path in (ROOT / folder).iterdir() if path.is_file()]
    assert files
    for path in files:
        found = hmcvt.data_path(f"{folder}/{path.name}")
        assert found.read_bytes() == path.read_bytes()


def test_unknown_file_is_refused():
    with pytest.raises(hmcvt.InputError, match=r"params/hm5\.yaml does not ship"):
        hmcvt.data_path("params/hm5.yaml")


def third_party(*folders):
    """What the Python files of some folders import from elsewhere, under the names of rosdep."""
    found = set()
    own = {
        "examples",
        "hmcvt_core",
        "hmcvt_tools",
        "hmcvt_ros",
        "setuptools",
        "studies",
        "tests",
    }
    own |= {path.stem for path in (ROOT / "docs").glob("*.py")}
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        own |= {path.stem} | ({path.parent.name} if path.stem == "__init__" else set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.partition(".")[0])
    return {KEYS.get(name, name) for name in found - own - sys.stdlib_module_names}


def optional():
    """The words in the extras that a robot does without; it writes the page of a diagnosis."""
    text = read("pyproject.toml")
    section = text.partition("[project.optional-dependencies]\n")[2].partition("\n[")[0]
    _, *parts = re.split(r"^(\w+) = ", section, flags=re.MULTILINE)
    extras = dict(zip(parts[::2], parts[1::2], strict=True))
    return {
        word
        for name in extras.keys() - {"ros", "tools", "report", "plot", "test", "dev"}
        for word in re.findall(r"[\w-]+", extras[name])
    }


def depends(kind):
    return {element.text for element in PACKAGE.iterfind(kind)}


def test_rosdep_installs_the_imports():
    # ros2launch is the command that starts the launch file.
    assert depends("exec_depend") - {"ros2launch"} == (
        third_party("hmcvt_core", "hmcvt_tools", "hmcvt_ros") - optional()
    )


def test_rosdep_installs_the_imports_of_the_tests():
    # rosdep has no key for cyclonedds.
    assert depends("test_depend") - {"python3-pytest-timeout"} == (
        third_party("tests") - depends("exec_depend") - optional() - {"cyclonedds"}
    )


def test_ros_files_are_installed():
    setup = read("setup.py")
    for folder in ("config", "launch", "security"):
        for path in (ROOT / "hmcvt_ros" / folder).iterdir():
            if path.is_file():
                assert (
                    f'(f"share/{{NAME}}/{folder}", ["hmcvt_ros/{folder}/{path.name}"])'
                    in setup
                )


def test_sdist_holds_what_the_tests_need(tmp_path):
    ignored = shutil.ignore_patterns(
        ".*", "__pycache__", "build", "dist", "site", "reproduction", "*.egg-info"
    )
    shutil.copytree(ROOT, tmp_path / "source", ignore=ignored)
    build = "import setuptools.build_meta as b; b.build_sdist('../dist')"
    done = subprocess.run(
        [sys.executable, "-c", build],
        cwd=tmp_path / "source",
        capture_output=True,
        text=True,
        timeout=250,
    )
    assert done.returncode == 0, done.stderr
    (archive,) = (tmp_path / "dist").iterdir()
    with tarfile.open(archive) as opened:
        names = {name.partition("/")[2] for name in opened.getnames()}
    for folder in ("data", "docs", "examples", "params", "studies", "tests"):
        source = tmp_path / "source"
        files = [path for path in (source / folder).rglob("*") if path.is_file()]
        missing = {str(path.relative_to(source)) for path in files} - names
        assert missing == set()


HEADER = "# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0"


def test_every_source_file_has_the_licence_header():
    missing = [
        str(path.relative_to(ROOT))
        for folder in (
            "docs",
            "examples",
            "hmcvt_core",
            "hmcvt_tools",
            "hmcvt_ros",
            "studies",
            "tests",
        )
        for path in (ROOT / folder).rglob("*.py")
        if (text := path.read_text(encoding="utf-8")) and text.split("\n")[0] != HEADER
    ]
    assert missing == []


def test_placeholders_are_marked_and_valid():
    text = read("package.xml")
    block = text.partition("<!-- PLACEHOLDERS")[2].partition(
        "<!-- End of the placeholders"
    )[0]
    assert text.count("example.org") == block.count("example.org") > 0
    for tag in ("maintainer", "author"):
        # What catkin_pkg, and so colcon, takes for an address.
        assert re.fullmatch(
            r"[-\w%+]+(\.[-\w%+]+)*@[-\w%]+(\.[-\w%]+)*\.[a-zA-Z]{2,}",
            PACKAGE.find(tag).get("email"),
        )
    assert {url.get("type") for url in PACKAGE.iterfind("url")} == {
        "website",
        "repository",
        "bugtracker",
    }


def test_dependencies_are_locked():
    pinned = re.findall(r"^([\w.-]+)==", read("constraints.txt"), re.MULTILINE)
    lines = read("pyproject.toml").partition("[tool.")[0].split("\n")
    lines = [line for line in lines if line.startswith("dependencies = ")] + lines[
        lines.index("[project.optional-dependencies]") :
    ]
    asked = re.findall(r'"([\w-]+)[^"]*"', "\n".join(lines))
    assert len(asked) > 20
    assert {name.lower() for name in asked} - set(pinned) == {"hmcvt_ros"}


def test_launch_file_and_systemd_restart_the_node():
    launch = ast.parse(read("hmcvt_ros/launch/hmcvt.launch.py"))
    (node,) = (
        call
        for call in ast.walk(launch)
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Name)
        and call.func.id == "Node"
    )
    given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    assert given["respawn"] == "LaunchConfiguration('respawn')"
    assert float(given["respawn_delay"]) > 0.0
    page = read("docs/deploy.md")
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read_string(re.search(r"```ini\n(.*?)```", page, re.DOTALL)[1])
    service = unit["Service"]
    assert (
        service["Restart"] == "on-failure"
        and service["RestartPreventExitStatus"] == "2"
    )
    assert service["MemoryMax"] and service["OOMPolicy"] == "continue"
    # It would end a node that does not report to systemd.
    assert "WatchdogSec" not in service


def test_citation_is_of_this_version():
    citation = yaml.safe_load(read("CITATION.cff"))
    assert citation["version"] == hmcvt.__version__
    # What the format asks for; GitHub shows nothing without them.
    assert citation["cff-version"] == "1.2.0"
    assert citation["title"] == "hmcvt" and citation["authors"] and citation["message"]
    assert citation["license"] == "Apache-2.0"
    (paper,) = citation["references"]
    assert paper["type"] == "article" and "HMCVT" in paper["title"] and paper["authors"]


def test_changelog_begins_with_this_version():
    versions = re.findall(r"^## \[(\S+)\]", read("CHANGELOG.md"), flags=re.MULTILINE)
    released = [version for version in versions if version.lower() != "unreleased"]
    assert released[0] == hmcvt.__version__
    entry = (
        read("CHANGELOG.md")
        .partition(f"## [{hmcvt.__version__}]")[2]
        .partition("\n## ")[0]
    )
    assert "\n* " in entry
    numbers = [tuple(map(int, version.split("."))) for version in released]
    assert numbers == sorted(set(numbers), reverse=True)


def test_web_site_has_every_page_once():
    named = re.findall(r"^ +- .*?([\w/-]+\.md)$", read("mkdocs.yml"), re.MULTILINE)
    docs = ROOT / "docs"
    pages = [path.relative_to(docs).as_posix() for path in docs.rglob("*.md")]
    assert sorted(named) == sorted(pages)
    assert named[0] == "index.md"


def test_web_site_loads_nothing_from_the_network():
    theme = re.search(
        r"^theme:\n(.*?)^\S", read("mkdocs.yml"), re.DOTALL | re.MULTILINE
    )
    assert re.search(r"^  font: false$", theme[1], re.MULTILINE)
    # The theme would load this renderer from a server.
    for path in (ROOT / "docs").rglob("*.md"):
        assert "```mermaid" not in path.read_text(encoding="utf-8"), path


def test_changelog_has_the_sections_of_keep_a_changelog():
    sections = re.findall(r"^### (.*)$", read("CHANGELOG.md"), re.MULTILINE)
    allowed = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(sections) <= allowed | {"Breaking"}


def test_api_pages_list_every_public_name():
    named = [
        name
        for path in (ROOT / "docs").glob("api*.md")
        for name in re.findall(
            r"^::: hmcvt_(?:core|tools)[\w.]*\.(\w+)$",
            path.read_text("utf-8"),
            re.MULTILINE,
        )
    ]
    # These are of hmcvt_tools alone; older names of it are forwarded by hmcvt_core.
    of_tools = {"FmuFunction", "write_page"}
    assert sorted(named) == sorted((set(hmcvt.__all__) | of_tools) - {"__version__"})

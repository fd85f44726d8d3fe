# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The pages of the node against one that runs: tables, replies and files; and docs/layouts."""

import importlib.util
import json
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml
from dds_security import full
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from ros_bench import GOOD, command, message, send_table, without_middleware

import hmcvt_core as hmcvt
from hmcvt_core.identification.refit import refit
from hmcvt_ros.diagnostics import ALWAYS, LEVELS
from hmcvt_ros.inputs import INPUT_RANGES

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
PAGE = "\n".join(
    (ROOT / "docs" / name).read_text(encoding="utf-8")
    for name in ("node.md", "node-reference.md", "node-trouble.md")
)
REFERENCE = (ROOT / "docs" / "node-reference.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e-?\d+)?")
OF_EVERY_NODE = {"/rosout", "/parameter_events"}


def table(head, number=0):
    """The rows of the table whose head begins with a text, as lists of cells; code marks off."""
    rows = []
    for line in PAGE.split(f"\n| {head}")[number + 1].split("\n")[2:]:
        if not line.startswith("|"):
            break
        cells = re.split(r"(?<!\\)\|", line[1:-1])
        rows.append([cell.strip().replace("`", "") for cell in cells])
    return rows


def block(language):
    """The code blocks of a language, one after the other."""
    return "\n".join(re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL))


def reply(name):
    """The reply that the page shows under a name."""
    (text,) = re.findall(rf"<!-- reply: {name} -->\n```json\n(.*?)```", PAGE, re.DOTALL)
    return json.loads(text)


def same(written, real, path=""):
    """Whether two replies have the same keys and types, and numbers that agree within 5 %."""
    if isinstance(written, dict) and isinstance(real, dict):
        assert list(written) == list(real), path
        for key in written:
            same(written[key], real[key], f"{path}/{key}")
    elif isinstance(written, list) and isinstance(real, list):
        assert len(written) == len(real), path
        for i, (one, other) in enumerate(zip(written, real, strict=True)):
            same(one, other, f"{path}/{i}")
    elif isinstance(written, (int, float)) and path != "/seconds":
        assert real == pytest.approx(written, rel=0.05), path
    elif isinstance(written, str) and path != "/model":  # the last digits differ
        assert NUMBER.sub("#", written) == NUMBER.sub("#", real), path
        same(numbers_in(written), numbers_in(real), path)
    else:
        assert type(written) is type(real), path


def numbers_in(text):
    """The numbers in a text."""
    return [float(number) for number in NUMBER.findall(text)]


@pytest.fixture(scope="module")
def node(start_node, paper_file, tmp_path_factory):
    state = tmp_path_factory.mktemp("state")
    (state / "bench_samples.csv").write_text("what a power cut left")
    return start_node(paper_file, state=state)


@pytest.fixture(scope="module")
def replies(node, table2):
    """What the services answer in the order of the page."""
    found = {}
    send_table(node, table2)
    for service in ("reidentify", "diagnose", "revert", "clear_samples"):
        success, found[service] = node.player.call(service)
        assert success, found[service]
    return found


def endpoints(observer, namespace):
    """Topic, type, direction, reliability and durability of what a node has on the graph."""
    found = []
    for topic, _ in observer.get_topic_names_and_types():
        for direction, infos in (
            ("out", observer.get_publishers_info_by_topic(topic)),
            ("in", observer.get_subscriptions_info_by_topic(topic)),
        ):
            for info in infos:
                if (info.node_name, info.node_namespace) == ("hmcvt", namespace):
                    qos = info.qos_profile
                    words = (qos.reliability.name, qos.durability.name)
                    found.append(
                        (
                            topic,
                            info.topic_type,
                            direction,
                            *(word.lower().replace("_", " ") for word in words),
                        )
                    )
    return sorted(end for end in found if end[0] not in OF_EVERY_NODE)


def test_topics(node):
    written = sorted(
        (full(row[0], "hmcvt", node.namespace), *row[1:5]) for row in table("topic")
    )

    def found():
        return endpoints(node.player, node.namespace)

    assert node.player.wait_until(lambda: found() == written, 10.0), found()


def test_depth_of_the_queues(node):
    names, depths = [], []
    for topic, _, direction, _, _, depth, _ in table("topic"):
        end = "publisher" if direction == "out" else "subscription"
        names.append(
            f"qos_overrides.{full(topic, 'hmcvt', node.namespace)}.{end}.depth"
        )
        depths.append(int(depth))
    values = node.call(GetParameters, "get_parameters", names=names).values
    assert [value.integer_value for value in values] == depths


def test_services(node):
    written = {
        (full(name, "hmcvt", node.namespace), kind)
        for name, kind, _ in table("service")
    }
    graph = node.player.get_service_names_and_types_by_node("hmcvt", node.namespace)
    own = {(name, kind) for name, (kind,) in graph if kind.startswith("std_srvs/")}
    assert own == written
    for name, kind in re.findall(r"ros2 service call (\S+) (\S+)", PAGE):
        assert (f"{node.namespace}{name}", kind) in own


def test_parameters():
    path = ROOT / "docs" / "parameter_table.py"
    spec = importlib.util.spec_from_file_location("parameter_table", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.page(REFERENCE) == REFERENCE, "run: python docs/parameter_table.py"
    for word in re.findall(r"ros2 param set /hmcvt (\S+)", PAGE):
        assert f"| `{word}`" in PAGE


def test_states_and_levels():
    names = {
        DiagnosticStatus.OK: "OK",
        DiagnosticStatus.WARN: "WARN",
        DiagnosticStatus.ERROR: "ERROR",
    }
    assert {(state, level) for state, level, _ in table("state")} == {
        (state.value, names[level]) for state, level in LEVELS.items()
    }


def test_keys_of_the_diagnostics(node, replies):
    statuses = node.player.statuses
    assert node.player.wait_until(
        lambda: "gap verdict" in statuses["model"]["values"], 5.0
    )
    for number, part in enumerate(("inputs", "model", "gap")):
        keys = each_input(row[0] for row in table("key", number))
        assert sorted(statuses[part]["values"]) == sorted(keys)


def each_input(keys):
    """Return keys with the names of all inputs in place of `<input>`."""
    found = []
    for key in keys:
        found += [key.replace("<input>", limits.name) for limits in INPUT_RANGES]
    return dict.fromkeys(found)


def test_keys_that_every_message_has(node):
    written = {part: each_input(keys.split(", ")) for part, keys in table("status")}
    assert {part: set(keys) for part, keys in written.items()} == {
        part: set(keys) for part, keys in ALWAYS.items()
    }
    shortest = dict.fromkeys(written, 1000)

    def take(array):
        for status in array.status:
            part = status.name.rpartition(": ")[2]
            if status.hardware_id == f"{node.namespace[1:]}/hmcvt":
                keys = {pair.key for pair in status.values}
                assert keys >= set(written[part])
                shortest[part] = min(shortest[part], len(keys))

    topic = node.player.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
    assert node.comes(lambda: shortest["gap"] == len(written["gap"]), 20.0), shortest
    node.player.destroy_subscription(topic)


def test_files_of_the_state_folder(node, replies, refused):
    names = set()
    for folder in (node.state, refused[0].state):
        names |= {
            str(path.relative_to(folder))
            for path in folder.rglob("*")
            if path.is_file()
        }
    assert names == {row[0] for row in table("file")}


@pytest.mark.parametrize("service", ["reidentify", "revert", "clear_samples"])
def test_replies(replies, service):
    same(reply(service), replies[service])


def test_diagnosis_leaves_a_report_and_stands_in_diagnostics(node, replies):
    found, page = replies["diagnose"], node.state / "reports" / "0001.html"
    assert {
        "gap",
        "where",
        "component",
        "verdict",
        "causes",
        "sets",
        "shrinkage",
        "delivered",
        "next_tests",
        "advice",
    } <= set(found)
    assert found["gap"]["samples"] == 8 and found["report"] == "reports/0001.html"
    text = page.read_text()
    assert text.startswith("<!DOCTYPE html>") and text.rstrip().endswith("</html>")
    data = json.loads(page.with_suffix(".json").read_text())
    assert data == {key: found[key] for key in data} and data.keys() >= {
        "gap",
        "verdict",
    }
    assert node.says(f"diagnose: {found['verdict']}")
    assert f"report {page}" in node.log

    assert node.comes(lambda: node.value("gap verdict") == found["verdict"])
    values = node.status()["values"]
    assert values["running"] == "-"
    assert float(values["gap rmse [-]"]) == pytest.approx(
        found["gap"]["rmse"], rel=1e-3
    )
    leading = found["causes"][0]["effect"] if found["causes"] else "-"
    assert values["gap leading cause"].startswith(leading)
    fraction = found["shrinkage"]["fraction"]
    assert values["gap shrinkage [-]"] == (
        "-" if fraction is None else f"{fraction:.3f}"
    )
    assert values["gap of model"] == replies["reidentify"]["model"]
    assert values["report"] == "reports/0001.html"
    assert values["gap diagnosed"].endswith("Z, 8 samples")


def test_refit_that_leads_too_far_is_refused_and_kept_as_a_candidate(refused):
    node, (success, data) = refused
    assert not success
    same(reply("reidentify, refused"), data)
    served = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))

    # The reason names the change, the limit and the file, in the answer, the log and diagnostics.
    candidate = node.state / "candidates" / "0001.yaml"
    assert data["candidate"] == "candidates/0001.yaml"
    for word in (
        f"{100 * data['drift']:.1f} points",
        "the 2 points allowed",
        data["candidate"],
    ):
        assert word in data["error"]
    assert node.says("reidentify: the refit would differ from the base model")
    assert "[WARN]" in next(
        line for line in node.log.splitlines() if "points allowed" in line
    )
    assert node.comes(
        lambda: "not adopted: the refit would differ" in node.value("last refit")
    )

    # The refit to all samples is there to be looked at; nothing of the service has changed.
    found = refit(hmcvt.read_bench(node.bench_file), served, served)
    assert hmcvt.load_model(candidate).fingerprint == found.model.fingerprint
    assert served.fingerprint in node.player.model_text
    assert node.player.hold(GOOD).efficiency == served.efficiency(*GOOD)
    assert list((node.state / "models").iterdir()) == []
    assert not node.player.call("revert").success


# --- what one can do with it ----------------------------------------------------------------------


@pytest.fixture
def run_node(environment, tmp_path):
    """Run a node with more ROS arguments."""
    processes = []

    def run(*arguments):
        processes.append(
            subprocess.Popen(command(f"state_folder:={tmp_path}", arguments=arguments))
        )

    yield run
    for process in processes:
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=10) == 0


def test_quality_of_service_can_be_overridden(run_node, connect, tmp_path):
    path = tmp_path / "qos.yaml"
    path.write_text(block("yaml"))
    changed = yaml.safe_load(block("yaml"))["/**"]["ros__parameters"]["qos_overrides"]
    expected = {
        f"/tractor1/{name.replace('~', 'hmcvt')}": reliability
        for name, _, _, reliability, *_ in table("topic")
        if name != "/diagnostics"
    }
    for topic, ends in changed.items():
        (values,) = ends.values()
        expected[topic] = values["reliability"].replace("_", " ")
    run_node("-r", "__ns:=/tractor1", "--params-file", str(path))
    observer = connect("/observer")

    def found():
        return {
            topic: reliability
            for topic, _, _, reliability, _ in endpoints(observer, "/tractor1")
            if topic != "/diagnostics"
        }

    assert observer.wait_until(lambda: found() == expected, 10.0), found()


def test_python_example_runs(run_node, environment, tmp_path):
    run_node()
    shipped = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    result = subprocess.run(
        [sys.executable, "-c", block("python")],
        env=dict(environment),
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=200,
    )
    lines = without_middleware(result.stdout).splitlines()
    assert len(lines) > 3, result.stderr
    efficiency, optimum = map(float, re.findall(r"=(0\.\d+)", lines[0]))
    assert (round(efficiency, 2), round(optimum, 2)) == (0.76, 0.04)
    assert lines[1] == shipped.fingerprint and f": {shipped.fingerprint}," in PAGE
    assert f"`{shipped.fingerprint}:HM4`" in REFERENCE
    assert lines[2] == "no_gap"
    assert {f"{float(line):.2f}" for line in lines[3:]} == {"0.62"}
    assert "# prints efficiency 0.62," in PAGE
    # The refit answers as the shipped model does, and states a wider range.
    refitted = hmcvt.load_model(tmp_path / "models" / "0001.yaml")
    assert refitted.fingerprint == shipped.fingerprint
    assert refitted.domain != shipped.domain
    assert refitted.domain == refitted.domain.united(shipped.domain)


def test_own_program_of_the_page_refits_and_ends_at_an_interrupt(
    environment, connect, tmp_path, table2
):
    section = PAGE.split("## In your own program\n")[1].split("\n## ")[0]
    lines = re.findall(r"^    (.*)$|^()$", section, re.MULTILINE)
    text = "\n".join(line for line, _ in lines)
    assert '"my_unit.yaml"' in text
    unit = hmcvt.data_path("params/hm4.yaml")
    program = tmp_path / "program.py"
    program.write_text(text.replace("my_unit.yaml", str(unit)))
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, str(program)],
            env={**environment, "ROS_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)},
            stdout=log,
            stderr=log,
        )
    try:
        player = connect("/tractor1")
        assert player.wait_for_node(60.0, running=lambda: process.poll() is None)
        assert player.hold(GOOD).efficiency is not None
        for i in range(len(table2)):
            player.send_sample(message(table2, i))
        assert player.wait_for_logged(len(table2))
        done, found = player.call("reidentify")
        assert done, found
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert "Traceback" not in (tmp_path / "log").read_text()
    finally:
        process.kill()
        process.wait()


def test_command_line_that_the_launch_file_makes(run_node, connect, tmp_path):
    # launch_ros is on no machine without ROS from apt; this is what it would start.
    path = tmp_path / "launch_params"
    path.write_text("/**:\n  ros__parameters:\n    use_sim_time: true\n")
    run_node(
        "--log-level",
        "warn",
        "--enclave",
        "/hmcvt",
        "--ros-args",
        "-r",
        "__node:=cvt",
        "-r",
        "__ns:=/launched",
        "--params-file",
        str(ROOT / "hmcvt_ros/config/hmcvt.yaml"),
        "--params-file",
        str(path),
    )
    observer = connect("/observer")

    def found():
        return observer.get_node_names_and_namespaces_with_enclaves()

    assert observer.wait_until(
        lambda: ("cvt", "/launched", "/hmcvt") in found(), 10.0
    ), found()
    assert observer.wait_until(
        lambda: (
            "cvt"
            in (
                info.node_name
                for info in observer.get_subscriptions_info_by_topic("/clock")
            )
        ),
        10.0,
    )


def test_every_test_named_exists():
    for row in table("..."):
        file, _, name = row[2].partition("::")
        assert re.search(
            rf"^def {name}\(", (ROOT / "tests" / "ros" / file).read_text(), re.M
        ), row


def test_launch_arguments():
    text = (ROOT / "hmcvt_ros" / "launch" / "hmcvt.launch.py").read_text()
    written = [row[0] for row in table("launch argument")]
    assert written == re.findall(r'^    "(\w+)": \(', text, re.M)


# --- docs/layouts: about the topics of the node ---------------------------------------------------

LAYOUTS = ROOT / "docs" / "layouts"
PLOTJUGGLER, FOXGLOVE = LAYOUTS / "plotjuggler.xml", LAYOUTS / "foxglove.json"
INPUTS = {"/displacement_ratio", "/engine_speed", "/load_torque"}
OUTPUTS = {"/efficiency", "/optimal_displacement_ratio"}
SEEN = {
    f"/{row[0].replace('~', 'hmcvt').lstrip('/')}": row[1] for row in table("topic")
}


def plotted(curve, separator):
    """The topic of a plotted field of a Float64."""
    topic, field = curve.rsplit(separator, 1)
    assert field == "data" and SEEN[topic] == "std_msgs/msg/Float64", curve
    return topic


def test_plotjuggler():
    root = ElementTree.parse(PLOTJUGGLER).getroot()
    assert (
        root.tag == "root"
        and root.find("tabbed_widget/Tab/Container/DockSplitter") is not None
    )
    for splitter in root.iter("DockSplitter"):
        assert (
            len(splitter.get("sizes").split(";"))
            == len(splitter)
            == int(splitter.get("count"))
        )
    curves = [plotted(curve.get("name"), "/") for curve in root.iter("curve")]
    assert sorted(curves) == sorted(INPUTS | OUTPUTS)


def test_foxglove():
    layout = json.loads(FOXGLOVE.read_text(encoding="utf-8"))
    assert set(layout) == {
        "configById",
        "globalVariables",
        "userNodes",
        "playbackConfig",
        "layout",
    }
    configs = layout["configById"]
    # Every panel is placed, once.
    placed = re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout["layout"]))
    assert sorted(placed) == sorted(configs)
    curves, shown = [], set()
    for config in configs.values():
        curves += [plotted(path["value"], ".") for path in config.get("paths", ())]
        shown |= {
            config[key] for key in ("topicToRender", "topicPath") if key in config
        }
    assert sorted(curves) == sorted(INPUTS | OUTPUTS)
    assert (
        shown == {"/diagnostics", "/hmcvt/model", "/hmcvt/efficiency_map"} <= set(SEEN)
    )


@pytest.mark.parametrize(
    ("path", "kept"), [(FOXGLOVE, {"/diagnostics"}), (PLOTJUGGLER, set())]
)
def test_namespace_as_the_page_tells(path, kept, tmp_path):
    page = (ROOT / "docs" / "live-view.md").read_text(encoding="utf-8")
    (line,) = re.findall(
        rf"^    (sed .*layouts/{path.name}) > ", page, flags=re.MULTILINE
    )
    done = subprocess.run(
        ["sh", "-c", line],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=20,
    )

    def topics(text):
        return re.findall(r'"(/[\w/]+)', text)

    plain = topics(path.read_text(encoding="utf-8"))
    assert topics(done.stdout) == [
        name if name in kept else f"/tractor1{name}" for name in plain
    ]
    assert len(plain) >= 5

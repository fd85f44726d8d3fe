# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The layouts in docs/layouts: whole, and about the topics of the node.

That docs/node.md names the topics of the node is held by tests/ros/test_node_docs.py.
"""

import json
import re
import subprocess
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parent.parent / "docs"
PLOTJUGGLER, FOXGLOVE = DOCS / "layouts" / "plotjuggler.xml", DOCS / "layouts" / "foxglove.json"
INPUTS = {"/displacement_ratio", "/engine_speed", "/load_torque"}
OUTPUTS = {"/efficiency", "/optimal_displacement_ratio"}


def node_topics():
    """Topics with their types, as full names of a node without a namespace."""
    text = (DOCS / "node.md").read_text(encoding="utf-8")
    section = text.partition("\n## Topics\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `([^`]+)` \| (\S+) \|", section, flags=re.MULTILINE)
    return {f"/{name.replace('~', 'hmcvt').lstrip('/')}": kind for name, kind in rows}


def plotted(curve, separator):
    """The topic of a plotted field of a Float64."""
    topic, field = curve.rsplit(separator, 1)
    assert field == "data" and node_topics()[topic] == "std_msgs/msg/Float64", curve
    return topic


def panels(part):
    """Panels in the order in which a Foxglove layout places them."""
    if isinstance(part, str):
        return [part]
    assert set(part) == {"first", "second", "direction", "splitPercentage"}
    assert part["direction"] in ("row", "column") and 0 < part["splitPercentage"] < 100
    return panels(part["first"]) + panels(part["second"])


def test_plotjuggler():
    root = ElementTree.parse(PLOTJUGGLER).getroot()
    assert root.tag == "root" and root.find("tabbed_widget/Tab/Container/DockSplitter") is not None
    for splitter in root.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes").split(";")]
        assert len(sizes) == len(splitter) == int(splitter.get("count"))
        assert sum(sizes) == pytest.approx(1.0)
    for limits in root.iter("range"):
        left, right, bottom, top = (
            float(limits.get(end)) for end in ("left", "right", "bottom", "top"))
        assert left < right and bottom < top
    curves = [plotted(curve.get("name"), "/") for curve in root.iter("curve")]
    assert sorted(curves) == sorted(INPUTS | OUTPUTS)


def test_foxglove():
    layout = json.loads(FOXGLOVE.read_text(encoding="utf-8"))
    assert set(layout) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    configs = layout["configById"]
    assert sorted(panels(layout["layout"])) == sorted(configs)
    curves, shown = [], set()
    for config in configs.values():
        curves += [plotted(path["value"], ".") for path in config.get("paths", ())]
        shown |= {config[key] for key in ("topicToRender", "topicPath") if key in config}
    assert sorted(curves) == sorted(INPUTS | OUTPUTS)
    assert shown == {"/diagnostics", "/hmcvt/model", "/hmcvt/efficiency_map"} <= set(node_topics())
    assert {name.partition("!")[0] for name in configs} == {
        "Plot", "DiagnosticSummary", "DiagnosticStatusPanel", "RawMessages"}


@pytest.mark.parametrize(("path", "kept"), [(FOXGLOVE, {"/diagnostics"}), (PLOTJUGGLER, set())])
def test_namespace_as_the_page_tells(path, kept, tmp_path):
    page = (DOCS / "live-view.md").read_text(encoding="utf-8")
    line, = re.findall(rf"^    (sed .*layouts/{path.name}) > ", page, flags=re.MULTILINE)
    done = subprocess.run(["sh", "-c", line], cwd=DOCS.parent, capture_output=True, text=True,
                          check=True, timeout=20)
    def topics(text):
        return re.findall(r'"(/[\w/]+)', text)

    plain = topics(path.read_text(encoding="utf-8"))
    assert topics(done.stdout) == [
        name if name in kept else f"/tractor1{name}" for name in plain]
    assert len(plain) >= 5

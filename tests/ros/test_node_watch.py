# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The node says that a gap has opened, since when and how large, and refits nothing."""

from __future__ import annotations

import dataclasses

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from ros_bench import send_table

import hmcvt_core as hmcvt
from studies.watch import NOISE, stream, well_known


def test_a_gap_that_opens_is_told_in_diagnostics(start_node, tmp_path):
    path, model = tmp_path / "p.yaml", well_known()
    hmcvt.save_model(model, path)
    node = start_node(path, bench_noise=NOISE)
    samples = stream(model, 0, "charge_pump", 0.03, samples=115)
    speed = model.output_speed(*samples.points[:3])
    samples = dataclasses.replace(samples, output_speed=speed)
    send_table(node, samples.select(range(100)))
    assert node.comes(lambda: node.value("samples", "gap") == "100")
    assert node.status("gap")["level"] == DiagnosticStatus.OK
    assert node.status("gap")["message"].startswith("no gap has opened in 100 samples")

    send_table(node, samples.select(range(100, 115)))
    assert node.comes(lambda: node.value("samples", "gap") == "115")
    found = hmcvt.watch(model, samples, noise=NOISE)
    assert node.status("gap")["level"] == DiagnosticStatus.WARN
    assert node.status("gap")["message"] == str(found) and found.open
    assert node.value("since", "gap") == str(found.since)
    assert float(node.value("size", "gap")) == pytest.approx(found.size, rel=1e-4)
    # It goes on with the model that it has.
    assert node.value("fingerprint") == model.fingerprint
    assert list(node.state.glob("models/*")) == []

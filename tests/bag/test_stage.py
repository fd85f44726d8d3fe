# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The stage engaged arrives in the samples: from `header.frame_id` and from the topic `stage`."""

import numpy as np
import pytest

from hmcvt_core import read_bench
from hmcvt_core.errors import InputError
from hmcvt_ros.bag import ImportSettings, import_bag

from .simulated import (
    START,
    TEXT,
    bench_records,
    run_bench,
    signal_records,
    text,
    write_bag,
)

HOLD = 10.0
STAGES = ("HM2", "HM4", "HM3")


@pytest.fixture(scope="module")
def steady(model):
    """One operating point held for 30 s: only the stage changes."""
    return run_bench(model, [(0.5, 120.0, 200.0)], hold=3 * HOLD, noise=1e-5)


def stage_at(seconds):
    return STAGES[int(seconds // HOLD)]


def frames(bench):
    """`frame_id` of each message by the stage engaged."""
    return lambda i: stage_at(bench.time[i] - START)


def announcements(topic="/stage", shift=-0.5):
    """The stage on its topic, half a second before it is used."""
    return [
        (topic, TEXT, START + HOLD * i + shift, text(name))
        for i, name in enumerate(STAGES)
    ]


@pytest.fixture
def imported(tmp_path):
    def run(records, **settings):
        return import_bag(
            write_bag(tmp_path / "run", records), ImportSettings(**settings)
        )

    return run


def test_frame_id_names_the_stage(imported, steady):
    samples, report = imported(bench_records(steady, frame=frames(steady)))
    assert samples.extra["stage"] == STAGES
    assert report.stages == dict.fromkeys(STAGES, 1)
    assert report.gaps == 0 and report.seconds_logged == pytest.approx(30.0, abs=0.1)
    assert report.notes == ("stages from header.frame_id: HM2, HM3, HM4",)
    assert "samples by stage: 1 in HM2, 1 in HM4, 1 in HM3" in report.text()


def test_topic_names_the_stage(imported, steady):
    samples, report = imported(bench_records(steady) + announcements())
    assert samples.extra["stage"] == STAGES
    assert report.read["/stage"] == 3
    assert report.notes == ("stages from the topic stage: HM2, HM3, HM4",)


def test_topic_in_the_namespace_of_the_samples(imported, steady):
    records = bench_records(steady, "/tractor1/bench_sample")
    others = [("/tractor2/stage", TEXT, START - 1.0, text("H0"))]
    samples, _ = imported(records + announcements("/tractor1/stage") + others)
    assert samples.extra["stage"] == STAGES


def test_frame_id_comes_before_the_topic(imported, steady):
    def frame(i):
        return "HM3" if steady.time[i] - START < HOLD else ""

    samples, report = imported(bench_records(steady, frame=frame) + announcements())
    assert samples.extra["stage"] == ("HM3", "HM4", "HM3")
    assert "header.frame_id, else the topic stage" in report.notes[0]


@pytest.mark.parametrize("frame", ["base_link", "dyno_link", "dyno"])
def test_frame_of_coordinates_is_no_stage(imported, steady, frame):
    records = bench_records(steady, frame=lambda i: frame)
    samples, report = imported(records + announcements())
    assert samples.extra["stage"] == STAGES
    assert ("'dyno' is no stage" in report.notes[0]) == (frame == "dyno")


def test_no_stage_is_named(imported, steady):
    samples, report = imported(bench_records(steady, frame=lambda i: "base_link"))
    assert samples.extra == {} and report.stages == {} and report.notes == ()


def test_stage_can_be_left_alone(imported, steady):
    records = bench_records(steady, frame=frames(steady)) + announcements()
    samples, report = imported(records, use_stage=False)
    assert "stage" not in samples.extra and len(samples) == 1
    assert "/stage" not in report.read


def test_messages_before_the_first_stage_are_refused(imported, steady):
    later = [("/stage", TEXT, START + 15.0, text("HM4"))]
    samples, report = imported(bench_records(steady) + later)
    assert samples.extra["stage"] == ("HM4",)
    assert report.refused["/bench_sample"] == {"no stage": pytest.approx(750, abs=2)}


def test_stage_that_comes_too_late_is_the_reason(imported, steady):
    with pytest.raises(InputError, match=r"no stage \(needs a message on the topic"):
        imported([*bench_records(steady), ("/stage", TEXT, START + 40.0, text("HM4"))])


def test_topic_of_another_type_is_noted(imported, steady):
    others = [
        record for record in signal_records(steady) if "engine/speed" in record[0]
    ]
    others = [("/stage", *record[1:]) for record in others]
    samples, report = imported(bench_records(steady) + others)
    assert "stage" not in samples.extra
    assert report.notes == ("/stage is std_msgs/msg/Float64, not String: not used",)


def test_averaged_messages_keep_their_stage(imported, steady):
    records = bench_records(steady, frame=frames(steady))[::100]
    samples, _ = imported(records, averaged=True)
    assert list(samples.extra["stage"]) == [stage_at(i * 2.0) for i in range(15)]


def test_command_writes_the_column(hmcvt, tmp_path, steady, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "run", bench_records(steady) + announcements())
    found = hmcvt("import-bag", "run", "--out", "samples.csv", "--json").json
    assert found["stages"] == {"HM2": 1, "HM4": 1, "HM3": 1}
    samples = read_bench("samples.csv")
    assert samples.extra["stage"] == STAGES
    assert np.allclose(samples.load_torque, 200.0, rtol=1e-3)
    hmcvt("import-bag", "run", "--out", "samples.csv", "--no-stage")
    assert "stage" not in read_bench("samples.csv").extra

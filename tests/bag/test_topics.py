# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which topics are read, and the messages about a bag without them."""

import sys

import pytest
from rosbags.rosbag2 import Writer

from hmcvt_core.errors import InputError
from hmcvt_ros.bag import ImportSettings, import_bag

from .simulated import (
    NUMBER,
    SHAFTS,
    START,
    TEMPERATURE,
    TYPES,
    bench_records,
    number,
    temperature,
    write_bag,
)


def refusal(path, **settings):
    """The one line said about a bag."""
    with pytest.raises(InputError) as caught:
        import_bag(path, ImportSettings(**settings))
    text = str(caught.value)
    assert str(path) in text and "\n" not in text
    return text


@pytest.fixture(params=["sqlite3", "mcap"])
def bag(request, tmp_path, quiet):
    return write_bag(tmp_path / "run", bench_records(quiet), request.param)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"namespace": "tractor1/rear"},
        {"namespace": "/tractor1/rear/"},
        {"topic": "rear/bench_sample"},
        {"topic": "/tractor1/rear/bench_sample"},
        {"topic": "rear/bench_sample", "namespace": "tractor1"},
    ],
)
def test_a_topic_is_found_by_the_end_of_its_name(tmp_path, quiet, settings):
    path = write_bag(
        tmp_path / "run", bench_records(quiet, "/tractor1/rear/bench_sample")
    )
    report = import_bag(path, ImportSettings(**settings)).report
    assert list(report.read) == ["/tractor1/rear/bench_sample"]


@pytest.mark.parametrize(
    "settings",
    [
        {"namespace": "tractor2"},
        {"namespace": "/"},
        {"topic": "/bench_sample"},
        {"topic": "sample"},
    ],
)
def test_no_such_topic(tmp_path, quiet, settings):
    path = write_bag(tmp_path / "run", bench_records(quiet, "/tractor1/bench_sample"))
    text = refusal(path, **settings)
    assert f"holds no topic {settings.get('topic', 'bench_sample')}" in text
    assert f"/tractor1/bench_sample ({SHAFTS})" in text


def test_two_namespaces_need_a_choice(tmp_path, quiet):
    other = quiet._replace(displacement_ratio=quiet.displacement_ratio - 0.2)
    records = bench_records(quiet, "/a/bench_sample") + bench_records(
        other, "/b/bench_sample"
    )
    records += [
        ("/a/oil_temperature", TEMPERATURE, START + 4.0, temperature(60.0)),
        ("/b/oil_temperature", TEMPERATURE, START + 4.0, temperature(80.0)),
    ]
    path = write_bag(tmp_path / "run", records)
    assert "/a/bench_sample and /b/bench_sample; choose one by --namespace" in refusal(
        path
    )
    chosen = import_bag(path, ImportSettings(namespace="b")).samples
    assert chosen.displacement_ratio[0] == pytest.approx(0.3, abs=1e-3)
    assert chosen.oil_temperature == [80.0]
    # With the full name, the temperature beside it is taken.
    chosen = import_bag(path, ImportSettings(topic="/a/bench_sample")).samples
    assert chosen.oil_temperature == [60.0]


@pytest.mark.parametrize(
    "others, note",
    [
        (
            [
                (
                    f"/{side}/oil_temperature",
                    TEMPERATURE,
                    START + 4.0,
                    temperature(60.0),
                )
                for side in ("left", "right")
            ],
            "/left/oil_temperature and /right/oil_temperature",
        ),
        (
            [("/oil_temperature", NUMBER, START + 4.0, number(60.0))],
            f"/oil_temperature is {NUMBER}, not Temperature: not used",
        ),
    ],
)
def test_temperatures_that_cannot_be_used_are_noted(tmp_path, quiet, others, note):
    samples, report = import_bag(
        write_bag(tmp_path / "run", bench_records(quiet) + others)
    )
    assert samples.oil_temperature is None
    assert len(report.notes) == 1 and report.notes[0].startswith(note)


@pytest.mark.parametrize(
    "topics, words",
    [
        (
            ("engine_speed", "load_torque", "displacement_ratio"),
            "engine_speed, load_torque, displacement_ratio alone cannot give a measured",
        ),
        (("bench_sample",), f"/bench_sample is {NUMBER}, not JointState"),
        ([f"sensor{i:02}" for i in range(30)], "/sensor00 "),
        ([f"sensor{i:02}" for i in range(30)], "and 18 more"),
    ],
)
def test_topics_without_shafts_are_told(tmp_path, topics, words):
    records = [(f"/{name}", NUMBER, START + 1.0, number(1.0)) for name in topics]
    assert words in refusal(write_bag(tmp_path / "run", records))


def test_a_definition_that_cannot_be_compiled_on_another_topic_does_no_harm(
    tmp_path, quiet
):
    with Writer(tmp_path / "run", version=9) as writer:
        other = writer.add_connection(
            "/other",
            "tractor/msg/Other",
            msgdef="float64 a\n??? b",
            rihs01=f"RIHS01_{'0' * 64}",
        )
        writer.write(other, int(START * 1e9), b"\x00\x01\x00\x00")
        shafts = writer.add_connection("/bench_sample", SHAFTS, typestore=TYPES)
        for _, kind, receipt, message in bench_records(quiet):
            writer.write(
                shafts, round(receipt * 1e9), TYPES.serialize_cdr(message, kind)
            )
    assert len(import_bag(tmp_path / "run").samples) == 1


def test_another_layout_under_the_same_name(tmp_path):
    with Writer(tmp_path / "run", version=9) as writer:
        shafts = writer.add_connection(
            "/bench_sample",
            "tractor/msg/JointState",
            msgdef="float64 a",
            rihs01=f"RIHS01_{'0' * 64}",
        )
        writer.write(shafts, int(START * 1e9), b"\x00\x01\x00\x00" + bytes(8))
    assert "layout that ROS 2 Jazzy does not know" in refusal(tmp_path / "run")


@pytest.mark.parametrize(
    "name, content, words",
    [
        ("nowhere", None, "there is no such bag"),
        (".", None, "is no bag"),
        ("bench.csv", b"a,b\n", "ends in .mcap or .db3"),
        *(
            (f"run{suffix}", content, "the bag cannot be read")
            for suffix in (".mcap", ".db3")
            for content in (b"", b"garbage" * 100)
        ),
    ],
)
def test_what_is_no_bag(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert words in refusal(tmp_path / name)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_an_empty_bag(tmp_path, storage):
    nothing = write_bag(tmp_path / "nothing", [], storage)
    assert "topics in it: none" in refusal(nothing)
    silent = write_bag(
        tmp_path / "silent", [], storage, topics=[("/bench_sample", SHAFTS)]
    )
    assert "/bench_sample holds no messages" in refusal(silent)


def test_no_message_can_be_used(tmp_path, quiet):
    records = [
        (topic, kind, receipt, b"\x00")
        for topic, kind, receipt, _ in bench_records(quiet)[:9]
    ]
    text = refusal(write_bag(tmp_path / "run", records))
    assert "none of the 9 messages on /bench_sample can be used: 9 unreadable" in text


def test_without_rosbags_the_cure_is_named(tmp_path, monkeypatch):
    for name in ("rosbags.rosbag2", "rosbags.typesys"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=r'pip install "\.\[bag\]"'):
        import_bag(tmp_path)

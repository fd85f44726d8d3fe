# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""From bags on disk to bench samples: what is recovered, refused, counted and told."""

import math
from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from hmcvt_core.errors import InputError
from hmcvt_ros.bag import ImportSettings, import_bag

from .simulated import (
    NUMBER,
    RATE,
    SHAFTS,
    START,
    TEMPERATURE,
    bench_records,
    joint_state,
    number,
    run_bench,
    temperature,
    write_bag,
)


@pytest.fixture(scope="session", params=["sqlite3", "mcap"])
def campaign(request, bench, tmp_path_factory):
    """The bag of the bench with transients in each storage, what it gives, what is told of it."""
    path = tmp_path_factory.mktemp(request.param) / "run1"
    write_bag(path, bench_records(bench), request.param)
    told = []
    return path, import_bag(path, progress=told.append), told


@pytest.fixture
def imported(tmp_path):
    """Write messages to a bag of their own and import them."""

    def run(records, **settings):
        path = tmp_path / f"run{len(list(tmp_path.iterdir()))}"
        return import_bag(write_bag(path, records), ImportSettings(**settings))

    return run


def test_each_hold_gives_one_true_sample(campaign, model, plan):
    samples, report = campaign[1]
    assert len(samples) == len(plan)
    assert samples.oil_temperature is None
    scores = (samples.efficiency - model.efficiency(*plan.T)) / samples.efficiency_std
    assert np.abs(scores).max() < 4.0 and 0.5 < np.sqrt(np.mean(scores**2)) < 1.7
    assert abs(scores.mean()) < 0.9  # three standard errors: transients leave no bias
    # The bound is no empty one: the deviations are a hundredth of the differences between points.
    assert samples.efficiency_std.max() < 0.005 < 0.1 < np.ptp(samples.efficiency)
    assert np.allclose(samples.displacement_ratio, plan[:, 0], atol=0.005)
    assert np.allclose(samples.engine_speed, plan[:, 1], rtol=0.002)
    assert np.allclose(samples.load_torque, plan[:, 2], rtol=0.012)
    assert np.allclose(samples.output_speed, model.output_speed(*plan.T), rtol=0.005)
    for window, middle in zip(report.windows, samples.stamp, strict=True):
        assert middle == pytest.approx(window.start + window.duration / 2.0)


def test_transients_are_rejected_and_counted(campaign, bench, plan):
    _, (_, report), told = campaign
    assert told[-1] == f"6000 of {len(bench.time)} messages" and len(told) == 3
    assert report.read == {"/bench_sample": len(bench.time)}
    assert report.refused == {"/bench_sample": {}}
    assert report.clock == "header stamp" and report.gaps == 0
    assert report.windows_found == len(plan) and report.windows_refused == {}
    assert report.seconds_logged == pytest.approx(12.0 * len(plan), abs=0.1)
    assert report.seconds_logged == pytest.approx(
        report.seconds_steady + report.seconds_transient
    )
    # Each way to another point takes about four time constants of 0.5 s.
    moving = np.count_nonzero(~bench.settled) / RATE
    assert moving < report.seconds_transient < moving + 3.0 * len(plan)
    assert report.seconds_steady == pytest.approx(
        sum(item.duration for item in report.windows)
    )
    assert sum(item.messages for item in report.windows) < len(bench.time)
    for window in report.windows:
        first = round((window.start - START) * RATE)
        assert bench.hold[first] == bench.hold[first + window.messages - 1]


def test_a_file_alone_and_a_folder_without_metadata_are_bags_too(campaign):
    path, (samples, _), _ = campaign
    (file,) = (item for item in path.iterdir() if item.suffix in (".mcap", ".db3"))
    assert np.array_equal(import_bag(file).samples.efficiency, samples.efficiency)
    metadata = path / "metadata.yaml"
    text = metadata.read_text(encoding="utf-8")
    metadata.unlink()
    try:
        assert np.array_equal(import_bag(path).samples.efficiency, samples.efficiency)
    finally:
        metadata.write_text(text, encoding="utf-8")


def test_a_stroke_sensor_may_overshoot_at_full_stroke(imported, quiet):
    full = quiet._replace(displacement_ratio=np.full(len(quiet.time), 1.004))
    assert imported(bench_records(full)).samples.displacement_ratio == [1.0]


def test_one_message_without_a_stamp_leaves_no_mixture_of_clocks(imported, quiet):
    records = bench_records(quiet, latency=100.0)
    records[7] = (*records[7][:3], joint_state(quiet.rows[7]))
    samples, report = imported(records)
    assert report.clock == "time of receipt" and report.refused["/bench_sample"] == {}
    assert samples.stamp[0] == pytest.approx(START + 100.0 + 4.0, abs=0.2)


def test_a_pause_ends_a_window(imported, model):
    bench = run_bench(model, [(0.5, 120.0, 200.0)], hold=16.0, noise=1e-5)
    first, second = slice(0, 400), slice(400, 800)
    later = [
        (topic, kind, receipt + 3600.0, joint_state(row, seconds + 3600.0))
        for (topic, kind, receipt, _), row, seconds in zip(
            bench_records(bench)[second],
            bench.rows[second],
            bench.time[second],
            strict=True,
        )
    ]
    samples, report = imported(bench_records(bench)[first] + later)
    assert len(samples) == 2 and report.gaps == 1
    assert samples.stamp[1] - samples.stamp[0] == pytest.approx(3608.0, abs=0.5)
    assert report.seconds_logged == pytest.approx(16.0, abs=0.1)


def test_a_clock_that_starts_again_does_not_mix_two_runs(imported, model):
    runs = [
        run_bench(model, [(0.5, 120.0, load)], hold=8.0, noise=1e-5)
        for load in (150.0, 250.0)
    ]
    records = []
    for number_, bench in enumerate(runs):
        records += [
            (
                "/bench_sample",
                SHAFTS,
                START + 100.0 * number_ + i / RATE,
                joint_state(row, seconds),
            )
            for i, (row, seconds) in enumerate(zip(bench.rows, bench.time, strict=True))
        ]
    samples, report = imported(records)
    assert np.allclose(samples.load_torque, [150.0, 250.0], rtol=1e-4)
    assert report.gaps == 1


def test_messages_out_of_order_are_refused(imported, quiet):
    records = bench_records(quiet)
    late = [
        (*records[i][:2], records[i + 5][2] + 1e-4, records[i][3])
        for i in (50, 150, 250)
    ]
    report = imported([*records, *late]).report
    assert report.refused["/bench_sample"] == {"out of order": 3}
    assert report.read["/bench_sample"] == len(records) + 3


# --- slow topics ----------------------------------------------------------------------------------


def _temperatures(bench, topic="/oil_temperature", stamped=True, until=math.inf):
    """One reading a second, rising by 0.5 deg C a second from 60."""
    return [
        (
            topic,
            TEMPERATURE,
            START + i + 0.2,
            temperature(60.0 + 0.5 * i, START + i if stamped else 0.0),
        )
        for i in range(-1, int(bench.time[-1] - START) + 2)
        if i <= until
    ]


@pytest.mark.parametrize("stamped, delay", [(True, 0.0), (False, 0.2)])
def test_oil_temperature_is_aligned_by_interpolation(imported, quiet, stamped, delay):
    samples, report = imported(
        bench_records(quiet, latency=0.0) + _temperatures(quiet, stamped=stamped)
    )
    at = samples.stamp[0] - START - delay
    assert samples.oil_temperature[0] == pytest.approx(60.0 + 0.5 * at, abs=0.02)
    assert report.read["/oil_temperature"] == 10


def test_a_window_without_a_fresh_temperature_is_refused(imported, model):
    bench = run_bench(
        model, [(0.5, 120.0, 150.0), (0.5, 120.0, 250.0)], hold=10.0, noise=1e-5
    )
    records = bench_records(bench) + _temperatures(bench, until=9)
    samples, report = imported(records, age_limit=2.0)
    assert len(samples) == 1 and report.windows_found == 2
    (reason,) = report.windows_refused
    assert reason.startswith("no oil_temperature in time")


def test_oil_temperature_that_no_window_has_can_be_left_alone(imported, quiet):
    records = bench_records(quiet) + _temperatures(quiet, until=-1)
    samples, report = imported(records, age_limit=0.5, use_oil_temperature=False)
    assert samples.oil_temperature is None and list(report.read) == ["/bench_sample"]
    with pytest.raises(
        InputError, match="none of the 1 steady windows can be used: 1 no oil_temp"
    ):
        imported(records, age_limit=0.5)


def _two_joints(bench):
    """Messages without the joint `displacement`."""
    return [
        ("/bench_sample", SHAFTS, seconds, joint_state(row, names=("engine", "output")))
        for seconds, row in zip(bench.time, bench.rows, strict=True)
    ]


def test_the_displacement_ratio_may_come_on_its_own_topic(imported, quiet):
    strokes = [
        ("/displacement_ratio", NUMBER, START + i * 0.7, number(0.5)) for i in range(13)
    ]
    samples, report = imported(_two_joints(quiet) + strokes)
    assert samples.displacement_ratio[0] == pytest.approx(0.5)
    assert samples.engine_speed[0] == pytest.approx(120.0, rel=1e-3)
    assert report.read["/displacement_ratio"] == 13
    moving = [
        ("/displacement_ratio", NUMBER, START + i * 0.5, number(0.05 * i))
        for i in range(17)
    ]
    with pytest.raises(InputError, match="no steady window"):
        imported(_two_joints(quiet) + moving)


def test_a_stale_displacement_ratio_refuses_the_message(imported, model):
    bench = run_bench(model, [(0.5, 120.0, 200.0)], hold=16.0, noise=1e-5)
    strokes = [
        ("/displacement_ratio", NUMBER, START + i, number(0.5)) for i in range(7)
    ]
    samples, report = imported(_two_joints(bench) + strokes, age_limit=1.5)
    assert len(samples) == 1
    # 16 s of messages less 6 s of readings and 1.5 s after them.
    assert report.refused["/bench_sample"] == {
        "no displacement_ratio in time": pytest.approx(8.5 * RATE, abs=2)
    }


def test_messages_are_refused_by_reason(imported, quiet):
    """The counts add up, and the sample is that of the good messages."""
    row, names = quiet.rows[0], ("engine", "output", "displacement")
    fast, hot, negative = row.copy(), row.copy(), row.copy()
    fast[0], hot[3], negative[4] = 1400.0, 1e6, 40.0

    def state(row=row, **changes):
        return replace(joint_state(row), **changes)

    nan_speed, infinite = row.copy(), row.copy()
    nan_speed[0], infinite[1] = math.nan, math.inf
    bad = {
        "not finite": [joint_state(nan_speed), joint_state(infinite)],
        "wrong names": [
            state(name=["motor", *names[1:]]),
            state(name=["engine"] * 3),
            state(name=[]),
            joint_state(row, names=names[:2]),
        ],
        "unequal arrays": [
            state(effort=np.array([1.0, 2.0])),
            state(velocity=np.array([])),
            state(position=np.array([0.5])),
        ],
        "out of range": [joint_state(fast), joint_state(hot), joint_state(negative)],
        "unreadable": [b"\x00\x01\x00\x00\x01", b""],
    }
    wrong = [
        ("/bench_sample", SHAFTS, START + 0.0101 + 0.1 * i, message)
        for i, message in enumerate(chain(*bad.values()))
    ]
    slow = [
        ("/oil_temperature", TEMPERATURE, START + i, message)
        for i, message in enumerate([temperature(math.nan), temperature(353.0), b""])
    ]
    samples, report = imported(
        [*bench_records(quiet), *wrong, *_temperatures(quiet, stamped=False), *slow]
    )
    assert report.refused == {
        "/bench_sample": {reason: len(messages) for reason, messages in bad.items()},
        "/oil_temperature": {"not finite": 1, "out of range": 1, "unreadable": 1},
    }
    assert report.read["/bench_sample"] == len(quiet.time) + len(wrong)
    assert report.windows[0].messages == len(quiet.time)
    assert samples.engine_speed[0] == pytest.approx(120.0, rel=1e-3)


def test_steady_windows_outside_the_ranges_are_refused(imported, model):
    bench = run_bench(
        model, [(0.5, 120.0, 150.0), (0.5, 120.0, 250.0)], hold=10.0, noise=1e-5
    )
    # During the second hold the meter of the output torque is wired the wrong way round, or has
    # half its gain; or the engine stalls.
    for name, factor, reason in (
        ("output_torque", -1.0, "load_torque out of range"),
        ("output_torque", 2.0, "efficiency out of range"),
        ("engine_torque", 0.0, "efficiency out of range"),
    ):
        torque = np.where(bench.hold == 1, factor, 1.0) * getattr(bench, name)
        samples, report = imported(bench_records(bench._replace(**{name: torque})))
        assert len(samples) == 1 and samples.load_torque[0] == pytest.approx(
            150.0, rel=1e-3
        )
        assert report.windows_refused == {reason: 1} and report.windows_found == 2


# --- messages that are averages -------------------------------------------------------------------


def test_each_message_may_be_an_average(imported, model, plan):
    """A message a minute, each the average of a steady point."""
    ratio, engine, load = plan.T
    output = model.output_speed(*plan.T)
    rows = np.column_stack(
        [
            engine,
            load / model.efficiency(*plan.T),
            output,
            load * engine / output,
            ratio,
        ]
    )
    times = START + 60.0 * np.arange(len(plan))
    averages = [
        ("/bench_sample", SHAFTS, seconds, joint_state(row, seconds))
        for seconds, row in zip(times, rows, strict=True)
    ]
    with pytest.raises(InputError, match=r"come 60 s apart .*--averaged"):
        imported(averages)
    samples, report = imported(averages, averaged=True)
    assert np.allclose(samples.efficiency, model.efficiency(*plan.T))
    assert samples.efficiency_std is None  # one message does not tell
    assert np.allclose(samples.load_torque, plan[:, 2])
    assert np.array_equal(samples.stamp, times)
    assert report.windows_found == len(plan) and report.seconds_logged == 0.0

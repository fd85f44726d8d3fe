# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The bench log on disk."""

import threading
import zlib
from dataclasses import replace

import numpy as np
import pytest
from ros_bench import file_limit

import hmcvt_core as hmcvt
from hmcvt_ros import jobs, recorder
from hmcvt_ros.bench_log import BenchLog, rows_of
from studies.soak.kill_lines import sample


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.csv"


def filled(path, count):
    log = BenchLog(path, limit=100)
    for number in range(count):
        log.write(rows_of(sample(number)))
    return log


def values(path):
    """Return the rows without their chain, which changes when a row before is taken out."""
    return [line.rpartition(",")[0] for line in path.read_text().splitlines()[1:]]


def test_every_cut_of_the_file_leaves_the_whole_samples(path):
    filled(path, 3)
    whole = path.read_bytes()
    ends = [i for i, byte in enumerate(whole, 1) if byte == ord("\n")]
    for cut in range(len(whole)):
        path.write_bytes(whole[:cut])
        log = BenchLog(path, limit=100)
        kept = max(sum(end <= cut for end in ends) - 1, 0)
        assert len(log) == kept, cut
        assert (log.recovered == "") == (cut in ends), cut
        log.write(rows_of(sample(9)))
        read = hmcvt.read_bench(path)
        assert len(read) == kept + 1
        np.testing.assert_array_equal(read.stamp, [*range(kept), 9.0])
        for damaged in path.parent.glob("*damaged*"):
            assert damaged.read_bytes() == whole[:cut]
            damaged.unlink()


def test_full_log_refuses_and_set_aside_makes_room(path):
    log = BenchLog(path, limit=2)
    log.write(rows_of(sample(0)))
    log.write(rows_of(sample(1)))
    assert log.write(rows_of(sample(2))) == 0
    assert "2 samples and takes no more" in log.full
    count, kept = log.set_aside()
    assert count == 2 and len(hmcvt.read_bench(kept)) == 2
    assert log.set_aside() == (0, None)
    log.write(rows_of(sample(2)))
    log.write(rows_of(sample(3)))
    assert log.set_aside()[1] != kept
    assert len(hmcvt.read_bench(kept)) == 2


def test_failed_write_leaves_the_log_as_it_was(path):
    log = filled(path, 3)
    before = path.read_bytes()
    # The first bytes of the row fit: what a disk does that fills up.
    with file_limit(len(before) + 10), pytest.raises(OSError):
        log.write(rows_of(sample(3)))
    assert path.read_bytes() == before
    log.write(rows_of(sample(3)))
    assert len(hmcvt.read_bench(path)) == len(log) == 4


def test_torn_log_that_cannot_be_repaired_yet_is_repaired_later(path):
    filled(path, 3)
    with path.open("ab") as file:
        file.write(b"3.0,0.1")
    torn = path.read_bytes()
    with file_limit(20):
        log = BenchLog(path, limit=100)
        assert len(log) == 3 and "cannot be read or repaired" in log.recovered
        for _ in range(3):
            with pytest.raises(OSError):
                log.write(rows_of(sample(3)))
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    assert path.read_bytes() == torn
    log.write(rows_of(sample(3)))
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, np.arange(4.0))
    assert path.with_name("log.damaged-1.csv").read_bytes() == torn


def test_flipped_bits_change_no_value_silently(path):
    filled(path, 3)
    whole = path.read_bytes()
    original = values(path)
    for place in range(0, len(whole), 4):
        raw = bytearray(whole)
        raw[place] ^= 1 << place // 4 % 8
        path.write_bytes(raw)
        log = BenchLog(path, limit=100)
        assert log.recovered, place
        rows = values(path)
        assert len(rows) == len(log) >= 1  # a line end that is gone takes two
        assert set(rows) <= set(original)
    assert path.with_name(f"log.damaged-{place // 4 + 1}.csv").read_bytes() == bytes(
        raw
    )


def crc(text):
    return f"{text},{zlib.crc32(text.encode()):08x}"


@pytest.mark.parametrize("with_checksums", [False, True])
def test_log_of_an_earlier_version_is_taken_over(path, with_checksums):
    filled(path, 3)
    new = path.read_bytes()
    header, *rows = path.read_text().splitlines()
    header = header.removesuffix(",stated_std,crc,chain")
    rows = [row.rsplit(",", 3)[0] for row in rows]
    if with_checksums:
        header = f"{header},crc"
        rows = [crc(row) for row in rows]
    path.write_text("\n".join([header, *rows, ""]))
    log = BenchLog(path, limit=100)
    assert len(log) == 3 and log.recovered == ""
    assert path.read_bytes() == new
    log.write(rows_of(sample(3)))
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, np.arange(4.0))


def test_log_that_is_removed_or_moved_is_noticed_at_the_next_sample(path):
    log = filled(path, 5)
    path.unlink()
    log.write(rows_of(sample(5)))
    assert log.recovered.endswith("is gone, and 5 samples with it")
    log.write(rows_of(sample(6)))
    path.rename(path.with_name("rotated.csv"))
    log.write(rows_of(sample(7)))
    assert log.recovered.endswith("is gone, and 7 samples with it")
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, [7.0])
    # Another file of the same size.
    copy = path.read_bytes()
    path.rename(path.with_name("rotated.csv"))
    path.write_bytes(copy[:-20] + b"0" * 19 + b"\n")
    log.write(rows_of(sample(8)))
    assert "1 damaged lines taken out" in log.recovered
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, [8.0])


def test_rows_appended_again_are_set_aside(path, tmp_path):
    log = filled(path, 6)
    lines = path.read_bytes().splitlines(keepends=True)
    other = tmp_path / "other.csv"
    earlier = BenchLog(other, limit=100)
    for number in range(10, 19):
        earlier.write(rows_of(sample(number)))
    foreign = other.read_bytes().splitlines(keepends=True)
    for again in (lines[2:5], lines[1:], foreign[7:], lines[6:]):
        with path.open("ab") as file:
            file.writelines(again)
        log.check()
        assert f"{len(again)} damaged lines taken out" in log.recovered
        assert len(log) == 6
        np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, np.arange(6.0))


def test_link_in_place_of_the_log_is_not_followed(path, tmp_path):
    log = filled(path, 3)
    target = tmp_path / "target.csv"
    target.write_text("mine")
    path.unlink()
    path.symlink_to(target)
    for act in (log.check, log.set_aside, lambda: log.write(rows_of(sample(3)))):
        with pytest.raises(OSError, match="is a link"):
            act()
    assert target.read_text() == "mine" and path.is_symlink()


def test_stated_standard_deviation_is_logged_and_used(path):
    log = filled(path, 1)
    log.write(rows_of(replace(sample(1), efficiency_std=np.array([0.003]))))
    read = jobs.bench_of(path)
    np.testing.assert_allclose(read.efficiency_std, [0.0112 * 0.8, 0.003])
    assert jobs.bench_of(path, 0.02).efficiency_std.tolist() == [0.02, 0.003]
    log.set_aside()
    log.write(rows_of(sample(0)))
    assert jobs.bench_of(path).efficiency_std is None


@pytest.mark.parametrize(
    ("numbers", "missing"),
    [
        ([1, 2, 3], 0),
        ([40, 41, 42], 0),  # begun before we listened
        ([1, 2, 5, 6, 10], 5),
        ([1, 1, 2, 2, 3, 3, 1, 2], 0),  # three publishers
        ([7, 90, 8, 91, 9, 92], 0),  # two that had begun before
        ([1, 2, 60, 61, 70, 62, 71, 3], 0),  # three, by and by
        ([1, 2, 60, 1, 2, 3], 57),
        ([2**64 - 1, 2**64 - 1, 0], 0),  # not told
    ],
)
def test_missing_messages_are_counted_by_the_gaps_in_their_numbers(numbers, missing):
    counted = recorder.Numbers()
    for number in numbers:
        counted.take(number)
    assert counted.missing == missing


@pytest.fixture
def taken(path):
    """Make a recorder: it, its tally, and what it has warned of."""

    def make(limit):
        warned = []
        taker = recorder.Recorder(BenchLog(path, limit), warned.append, str)
        return taker, taker.tally, warned

    return make


def test_samples_beyond_what_may_wait_are_refused_and_told(path, taken, monkeypatch):
    monkeypatch.setattr(recorder, "MOST_WAITING", 5)
    taker, tally, warned = taken(100)
    go_on = threading.Event()
    taker.call(go_on.wait)  # a disk that takes its time
    for number in range(8):
        taker.submit(sample(number))
    assert warned == [] and tally.accepted == 0
    go_on.set()
    taker.call(lambda: None).result()
    assert len(warned) == 3 and "5 samples wait already" in warned[0]
    assert (tally.accepted, tally.refused[recorder.BUSY], len(taker.log)) == (5, 3, 5)
    assert (
        taker.complaint == "3 bench samples were sent and not taken: too many at once"
    )
    taker.call(taker.set_aside).result()
    assert taker.complaint == ""
    taker.submit(sample(9))
    taker.close()  # writes what waits
    assert (tally.accepted, len(hmcvt.read_bench(path))) == (6, 1)

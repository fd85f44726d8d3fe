# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The bench log on disk."""

import json
import threading
import zlib
from dataclasses import replace

import numpy as np
import pytest
from ros_bench import file_limit

import hmcvt_core as hmcvt
from hmcvt_core.transmission.quantities import STORED
from hmcvt_ros import bench_log, jobs, recorder
from hmcvt_ros.bench_log import BenchLog, require_intact, rows_of
from hmcvt_ros.numbering import Numbers
from studies.soak.edit_log import edited, trial
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
    return path.read_text().splitlines()[1:]


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.long)])
def test_every_cut_of_the_file_leaves_the_whole_samples(path, step):
    filled(path, 2)
    whole = path.read_bytes()
    ends = [i for i, byte in enumerate(whole) if byte == ord("\n")]
    around_ends = {end + after for end in ends for after in (-1, 0, 1)}
    for cut in sorted({*range(0, len(whole), step), *around_ends} - {len(whole)}):
        path.write_bytes(whole[:cut])
        log = BenchLog(path, limit=100)
        # A row is whole with its checksum, also without the end of its line.
        kept = max(sum(end <= cut for end in ends) - 1, 0)
        assert len(log) == kept, cut
        at_an_end = cut == 0 or cut in ends or cut - 1 in ends
        assert (log.recovered == "") == at_an_end, cut
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
    assert log.write(rows_of(sample(2))).logged == 0
    assert "2 samples and takes no more" in log.full
    count, kept = log.set_aside()
    assert count == 2 and len(hmcvt.read_bench(kept)) == 2
    assert log.set_aside() == (0, None)
    log.write(rows_of(sample(2)))
    log.write(rows_of(sample(3)))
    assert log.set_aside()[1] != kept
    assert len(hmcvt.read_bench(kept)) == 2


def test_log_that_nobody_changed_is_not_read_row_by_row(path, monkeypatch):
    log = filled(path, 3)
    reads = []
    read = bench_log._read

    def counted(*given):
        reads.append(given)
        return read(*given)

    monkeypatch.setattr(bench_log, "_read", counted)
    log.check()
    assert not reads and len(log) == 3
    raw = bytearray(path.read_bytes())
    raw[-5] ^= 1
    path.write_bytes(raw)  # of the same size
    log.check()
    assert len(reads) == 1 and len(log) == 2 and "damaged" in log.recovered
    log.check()
    assert len(reads) == 1
    log.write(rows_of(sample(7)))
    log.check()
    assert len(reads) == 1 and len(log) == 3


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


def test_log_of_an_earlier_version_is_taken_over(path):
    filled(path, 3)
    new = path.read_bytes()
    rows = [[*row.split(",")[1:7], "0.01"] for row in values(path)]
    header = "stamp,displacement_ratio,engine_speed,load_torque,efficiency,output_speed"
    lines = [f"{header},stated_std,crc,chain"]
    for cells in rows:
        body = ",".join(cells)
        lines.append(f"{body},{zlib.crc32(body.encode()):08x},00000000")
    path.write_text("\n".join([*lines, ""]))
    log = BenchLog(path, limit=100)
    assert len(log) == 3 and log.recovered == ""
    log.write(rows_of(sample(3)))
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, np.arange(4.0))
    assert values(path)[0].startswith(new.splitlines()[1][:10].decode())
    assert jobs.bench_of(path).efficiency_std[0] == 0.01
    lines[2] = lines[2].replace("0.8", "0.7")
    path.write_text("\n".join([*lines, ""]))
    log = BenchLog(path, limit=100)
    assert len(log) == 2 and "1 damaged lines taken out (line 3)" in log.recovered


def test_every_stored_quantity_comes_back_from_the_log(path):
    inside = {
        quantity.name: np.array([0.5 * (quantity.low + quantity.high)])
        for quantity in STORED
    }
    given = replace(sample(0), **inside)
    BenchLog(path, limit=100).write(rows_of(given))
    np.testing.assert_equal(jobs.bench_of(path).columns, given.columns)


@pytest.mark.parametrize("stage", [False, True])
def test_log_is_taken_over_when_a_quantity_is_added(path, stage):
    """As of a version without `stated_pressure`; a checksum depends on the cells of its row."""
    words = {"session": ("2",), **({"stage": ("HM1",)} if stage else {})}
    given = replace(sample(0), extra=words, oil_temperature=np.array([60.0]))
    BenchLog(path, limit=100, stages=stage).write(rows_of(given))
    now = path.read_bytes()
    header, row = (line.split(",") for line in path.read_text().splitlines())
    at = header.index("stated_pressure")
    body = ",".join([*row[:at], *row[at + 1 : -1]])
    names = ",".join([*header[:at], *header[at + 1 :]])
    path.write_text(f"{names}\n{body},x{zlib.crc32(body.encode()):08x}\n")
    before = path.read_bytes()
    require_intact(path)
    log = BenchLog(path, limit=100, stages=stage)
    assert (len(log), log.recovered) == (1, "")
    assert path.read_bytes() == now != before
    path.write_bytes(before.replace(b"60.0", b"61.0"))
    with pytest.raises(hmcvt.InputError, match="damaged is line 2"):
        require_intact(path)


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
    assert "1 damaged lines taken out (line 2)" in log.recovered
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, [8.0])


def test_rows_appended_again_count_once(path):
    log = filled(path, 6)
    lines = path.read_bytes().splitlines(keepends=True)
    for again in (lines[2:5], lines[1:], lines[6:]):
        with path.open("ab") as file:
            file.writelines(again)
        log.check()
        assert f"{len(again)} rows stood there more than once" in log.recovered
        assert len(log) == 6
        np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, np.arange(6.0))
    assert list(path.parent.glob("*.csv")) == [path]


def test_rows_that_are_gone_are_named(path):
    log = filled(path, 9)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([lines[0], *lines[2:4], lines[7], lines[6]]))
    log.check()
    assert log.recovered.endswith("gone are samples number 1, 4 to 5, 8 to 9")
    np.testing.assert_array_equal(hmcvt.read_bench(path).stamp, [1.0, 2.0, 5.0, 6.0])
    # A later start names them too, the last ones because their count is noted.
    later = BenchLog(path, limit=100)
    assert later.recovered.endswith("gone are samples number 1, 4 to 5, 8 to 9")
    path.with_suffix(".json").unlink()
    later = BenchLog(path, limit=100)
    assert later.recovered.endswith("gone are samples number 1, 4 to 5")
    later.write(rows_of(sample(8)))
    assert len(later) == 5
    later.set_aside()
    assert later.recovered == ""


def test_sample_with_the_stamp_and_values_of_another_counts_once(path):
    log = filled(path, 3)
    played = [row for number in range(4) for row in rows_of(sample(number))]
    assert log.write([*played, *played]) == (1, {0, 1, 2, 4, 5, 6, 7})
    assert BenchLog(path, limit=100).write(played) == (0, {0, 1, 2, 3})
    log.set_aside()
    assert log.write(played) == (4, frozenset())


@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_log_saved_by_a_spreadsheet_keeps_all_rows(path, mark, line_end):
    log = BenchLog(path, limit=100)
    for number in range(4):
        given = replace(sample(number), extra={"session": ("2",)})
        log.write(rows_of(given))
    before = path.read_bytes()
    saved = []
    for line in before.decode().splitlines():
        cells = []
        for cell in line.split(","):
            with_digits = cell.replace(".", "").isdigit()
            cells.append(f"{float(cell):.15g}" if with_digits else f'"{cell}"')
        text = mark.join(cells)
        saved.append(text if mark == "," else text.replace(".", ","))
    path.write_bytes(("\ufeff" + line_end.join(saved)).encode())
    log = BenchLog(path, limit=100)
    assert (len(log), log.recovered) == (4, "")
    assert path.read_bytes() == before


@pytest.mark.parametrize("place", [0, 1, 99])
def test_column_that_a_person_adds_is_taken_out_and_told(path, place):
    filled(path, 3)
    before = path.read_bytes()
    lines = [line.split(",") for line in before.decode().splitlines()]
    for number, cells in enumerate(lines):
        cells.insert(place, f"checked {number}" if number else "my note")
    path.write_text("\n".join(map(",".join, lines)))
    log = BenchLog(path, limit=100)
    assert len(log) == 3 and path.read_bytes() == before
    assert "taken out ('my note'), the file as it was is kept" in log.recovered


def test_columns_that_a_person_moves_keep_all_rows(path):
    filled(path, 3)
    before = path.read_bytes()
    lines = [line.split(",") for line in before.decode().splitlines()]
    for cells in lines:
        cells.insert(0, cells.pop(3))
        cells.insert(6, cells.pop())
    path.write_text("\n".join(map(",".join, lines)))
    log = BenchLog(path, limit=100)
    assert (len(log), log.recovered) == (3, "")
    assert path.read_bytes() == before


def test_row_with_a_number_that_the_log_never_gives_is_damaged(path):
    filled(path, 3)
    body = path.read_text().splitlines()[-1].split(",", 1)[1].rsplit(",", 1)[0]
    for number in (-7, 0, 10**16):
        text = f"{number},{body}"
        with path.open("a") as file:
            file.write(f"{text},x{zlib.crc32(text.encode()):08x}\n")
        log = BenchLog(path, limit=100)
        assert len(log) == 3
        assert "1 damaged lines taken out (line 5)" in log.recovered
        assert "gone" not in log.recovered


@pytest.mark.parametrize("rows", [0, 3])
def test_rows_missing_at_the_end_are_noticed_after_a_restart(path, rows):
    filled(path, 9).note()
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[: rows + 1]))
    later = BenchLog(path, limit=100)
    assert later.recovered.endswith(f"gone are samples number {rows + 1} to 9")
    path.unlink()
    later = BenchLog(path, limit=100)
    assert later.recovered.endswith("is gone, and 9 samples with it")
    assert BenchLog(path, limit=100).recovered == ""


def test_all_samples_that_are_gone_are_listed_in_a_file(path):
    filled(path, 90)
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[::2]))
    recovered = BenchLog(path, limit=100).recovered
    assert recovered.endswith("and 25 more, all of them in log.json")
    gone = json.loads(path.with_suffix(".json").read_text())["gone"]
    assert gone.split(", ") == [str(number) for number in range(1, 90, 2)]


@pytest.mark.parametrize(
    "seed",
    [*range(6), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(6, 20))],
)
def test_random_edits_lose_no_sound_row_and_name_the_rest(path, seed):
    filled(path, 60)
    rng = np.random.default_rng(seed)
    whole = path.read_bytes()
    for _ in range(5):
        path.write_bytes(whole)
        assert list(edited(path, rng, edits=int(rng.integers(1, 16)))) == []


@pytest.mark.slow
@pytest.mark.parametrize("rows", [2_500, pytest.param(10_000, marks=pytest.mark.long)])
def test_long_log_is_repaired_in_bounded_time_and_memory(path, rows):
    result = trial(path, rows=rows, edits=40, seed=0, traced=True)
    assert result.problems == []
    assert result.peak < 20e3 * rows
    assert result.longest < 2e-3 * rows  # traced, on a busy machine; a tenth otherwise


def test_file_that_is_too_large_for_a_log_is_set_aside_unread(path):
    with path.open("wb") as file:
        file.truncate(1 << 40)  # a sparse file of 1 TB
    log = BenchLog(path, limit=100)
    assert "too many for a log of 100 samples" in log.recovered
    log.write(rows_of(sample(0)))
    assert len(log) == 1
    (aside,) = path.parent.glob("*.damaged-1.csv")
    aside.unlink()


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
    counted = Numbers()
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
    monkeypatch.setattr(recorder, "MAX_WAITING", 5)
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

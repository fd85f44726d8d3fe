# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bags that a killed recorder, a full disk or a tool left damaged: what is read, what is said."""

import shutil
import sqlite3
from contextlib import closing

import numpy as np
import pytest
import yaml

from hmcvt_core.errors import InputError
from hmcvt_ros.bag import import_bag, read_bag

from .simulated import bench_records, run_bench, write_bag

SUFFIX = {"mcap": ".mcap", "sqlite3": ".db3"}
TOOL = {"mcap": "mcap recover", "sqlite3": "sqlite3"}


@pytest.fixture(params=["sqlite3", "mcap"])
def storage(request):
    return request.param


@pytest.fixture
def bag(storage, tmp_path, quiet):
    """A bag of one file with one steady window."""
    return write_bag(tmp_path / "run", bench_records(quiet), storage)


@pytest.fixture
def file(bag, storage):
    return bag / f"run{SUFFIX[storage]}"


@pytest.fixture
def runs(model):
    """Two runs of a bench, of another load each and one after the other."""
    found = []
    for i, load in enumerate((150.0, 250.0)):
        run = run_bench(model, [(0.5, 120.0, load)], hold=8.0, noise=1e-5)
        found.append(run._replace(time=run.time + 100.0 * i))
    return found


@pytest.fixture
def split(storage, tmp_path, runs):
    """A bag of two files with one steady window each; return the folder and the files."""
    folder = tmp_path / "split"
    folder.mkdir()
    names = [f"split_{i}{SUFFIX[storage]}" for i in (9, 10)]
    for name, run in zip(names, runs, strict=True):
        part = write_bag(tmp_path / f"part_{name}", bench_records(run), storage)
        (found,) = part.glob(f"*{SUFFIX[storage]}")
        found.rename(folder / name)
    metadata = yaml.safe_load((part / "metadata.yaml").read_text())
    (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    list_files(folder, names)
    return folder, [folder / name for name in names]


def refusal(path):
    """The one line said about a bag."""
    with pytest.raises(InputError) as caught:
        import_bag(path)
    text = str(caught.value)
    assert str(path) in text and "\n" not in text and "report issue" not in text
    return text


def change_metadata(bag, **changes):
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    content["rosbag2_bagfile_information"].update(changes)
    path.write_text(yaml.safe_dump(content))


def list_files(bag, names):
    files = [{"path": name} for name in names]
    change_metadata(bag, relative_file_paths=names, files=files)


def cut(file, part):
    content = file.read_bytes()
    file.write_bytes(content[: int(part * len(content))])


# --- metadata.yaml ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\n\n", "is empty"),
        (b"\0" * 512, "is empty"),
        (b"a: [", "is damaged"),
        (b"a: 1\n", "is damaged"),
        (b"rosbag2_bagfile_information: 3\n", "is damaged"),
        (b"rosbag2_bagfile_information:\n  relative_file_paths: []\n", "is damaged"),
        (b"\xff\xfe\x00", "is damaged"),
    ],
)
def test_damaged_metadata_leaves_the_files_readable(bag, content, words):
    whole = import_bag(bag).samples
    (bag / "metadata.yaml").write_bytes(content)
    samples, report = import_bag(bag)
    assert np.array_equal(samples.efficiency, whole.efficiency)
    (note,) = report.notes
    assert note.startswith(f"metadata.yaml {words}") and "ros2 bag reindex" in note


@pytest.mark.parametrize("part", [0.3, 0.6, 0.9])
def test_cut_off_metadata(bag, part):
    cut(bag / "metadata.yaml", part)
    assert len(import_bag(bag).samples) == 1


@pytest.mark.parametrize("name", ["", "unknown", None, 3])
def test_storage_follows_the_ending_of_the_file(bag, name):
    change_metadata(bag, storage_identifier=name)
    assert len(import_bag(bag).samples) == 1


@pytest.mark.parametrize("version", [1, 10, "x"])
def test_other_versions_of_the_metadata(bag, version):
    change_metadata(bag, version=version)
    assert len(import_bag(bag).samples) == 1


def test_renamed_file(bag, file):
    file.rename(bag / f"other{file.suffix}")
    samples, report = import_bag(bag)
    assert len(samples) == 1
    assert f"lists files that are missing ({file.name})" in report.notes[0]


def test_folder_of_metadata_alone(bag, file):
    file.unlink()
    assert f"the bag cannot be read: {file.name} is missing" in refusal(bag)
    (bag / "metadata.yaml").write_text("")
    assert "metadata.yaml is empty, and the folder holds no file" in refusal(bag)


def test_other_readers_log_what_is_missing(bag, caplog):
    (bag / "metadata.yaml").write_text("")
    assert len(read_bag(bag)) == 1
    assert "metadata.yaml is empty" in caplog.text


# --- parts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9])
def test_single_damaged_file_names_the_tool(bag, file, storage, part):
    cut(file, part)
    for path in (bag, file):
        text = refusal(path)
        assert "the bag cannot be read" in text and file.name in text
        assert (f"{file.name} is empty" if part == 0.0 else TOOL[storage]) in text
    (bag / "metadata.yaml").unlink()
    assert "the bag cannot be read" in refusal(bag)


def test_other_content_is_named(bag, file):
    file.write_bytes(b"garbage" * 100)
    assert (
        f"{file.name} is no {'MCAP' if file.suffix == '.mcap' else 'SQLite'} file"
        in (refusal(bag))
    )


@pytest.mark.parametrize("with_metadata", [True, False])
@pytest.mark.parametrize("damaged", [0, 1])
@pytest.mark.parametrize(("part", "words"), [(0.0, "is empty"), (0.5, "is cut off")])
def test_whole_parts_are_read_and_the_damaged_one_is_named(
    split, with_metadata, damaged, part, words
):
    folder, files = split
    if not with_metadata:
        (folder / "metadata.yaml").unlink()
    cut(files[damaged], part)
    samples, report = import_bag(folder)
    assert samples.load_torque == pytest.approx([(250.0, 150.0)[damaged]], rel=1e-3)
    (note,) = report.notes
    assert note.startswith(f"{files[damaged].name} {words}")


def test_missing_part_is_named(split):
    folder, files = split
    files[0].unlink()
    samples, report = import_bag(folder)
    assert len(samples) == 1 and report.notes == (f"{files[0].name} is missing",)


def test_unlisted_part_is_named(split):
    folder, files = split
    list_files(folder, [files[0].name])
    samples, report = import_bag(folder)
    assert len(samples) == 1
    assert report.notes[0].startswith(f"{files[1].name} is not listed")


def test_cut_off_list_of_files_leaves_all_files_readable(split):
    folder, files = split
    metadata = yaml.safe_load((folder / "metadata.yaml").read_text())
    information = metadata["rosbag2_bagfile_information"]
    del information["files"]
    for names in ([files[0].name], [files[0].name, "split_1"]):
        information["relative_file_paths"] = names
        (folder / "metadata.yaml").write_text(yaml.safe_dump(metadata))
        samples, report = import_bag(folder)
        assert samples.load_torque == pytest.approx([150.0, 250.0], rel=1e-3)
        (note,) = report.notes
        assert note.startswith("metadata.yaml is cut off") and "reindex" in note


def test_parts_are_read_in_the_order_of_recording(split):
    folder, _ = split
    (folder / "metadata.yaml").unlink()
    samples, report = import_bag(folder)
    assert samples.load_torque == pytest.approx([150.0, 250.0], rel=1e-3)
    assert report.notes == ()


@pytest.mark.parametrize("storage", ["mcap"], indirect=True)
def test_damage_in_the_middle_of_a_part(split):
    folder, files = split
    content = bytearray(files[0].read_bytes())
    middle = len(content) // 3
    content[middle : middle + 2000] = b"\xff" * 2000
    files[0].write_bytes(content)
    samples, report = import_bag(folder)
    assert samples.load_torque == pytest.approx([250.0], rel=1e-3)
    (note,) = report.notes
    assert note.startswith(f"{files[0].name} is damaged") and "mcap recover" in note


@pytest.fixture
def unclosed(tmp_path, runs):
    """A bag whose second run is still in the journal of SQLite: the recorder was killed."""
    whole = [
        write_bag(tmp_path / f"run{i}", bench_records(run), "sqlite3")
        for i, run in enumerate(runs)
    ]
    first, second = (path / f"{path.name}.db3" for path in whole)
    with closing(sqlite3.connect(first)) as connection:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA wal_autocheckpoint=0")
        connection.execute("ATTACH ? AS later", (str(second),))
        connection.execute(
            "INSERT INTO messages (topic_id, timestamp, data) "
            "SELECT topic_id, timestamp, data FROM later.messages"
        )
        connection.commit()
        killed = tmp_path / "killed"
        killed.mkdir()
        for suffix in (".db3", ".db3-wal"):
            shutil.copy(whole[0] / f"run0{suffix}", killed / f"killed_0{suffix}")
    return killed


def test_file_that_was_not_closed_is_read_with_its_journal(unclosed):
    before = {path.name: path.read_bytes() for path in unclosed.iterdir()}
    samples, report = import_bag(unclosed)
    assert samples.load_torque == pytest.approx([150.0, 250.0], rel=1e-3)
    (note,) = report.notes
    assert "killed_0.db3 was not closed" in note and "killed_0.db3-wal" in note
    assert before == {path.name: path.read_bytes() for path in unclosed.iterdir()}


def test_journal_of_garbage_harms_nothing(split, storage):
    folder, files = split
    journal = files[0].with_name(f"{files[0].name}-wal")
    journal.write_bytes(b"\x37\x7f\x06\x82" * 100)
    samples, report = import_bag(folder)
    assert len(samples) == 2
    assert len(report.notes) == (storage == "sqlite3")


# --- compression ------------------------------------------------------------------------------


@pytest.mark.parametrize("damaged_metadata", [False, True])
def test_compressed_file_is_unpacked(tmp_path, quiet, storage, damaged_metadata):
    path = write_bag(
        tmp_path / "run", bench_records(quiet), storage, compression="file"
    )
    (file,) = path.glob("*.zstd")
    if damaged_metadata:
        (path / "metadata.yaml").unlink()
    samples, report = import_bag(path)
    assert len(samples) == len(import_bag(file).samples) == 1
    if damaged_metadata:
        assert report.notes == (f"{file.name} was unpacked for reading",)
    cut(file, 0.5)
    assert f"zstd -d {file.name}" in refusal(path)


def test_unpacked_file_beside_the_metadata_of_the_compressed_one(
    tmp_path, quiet, storage
):
    plain = write_bag(tmp_path / "plain", bench_records(quiet), storage)
    path = write_bag(
        tmp_path / "run", bench_records(quiet), storage, compression="file"
    )
    (packed,) = path.glob("*.zstd")
    shutil.copy(plain / f"plain{SUFFIX[storage]}", path / packed.stem)
    packed.unlink()
    assert len(import_bag(path).samples) == 1


def test_compressed_messages_need_the_metadata(tmp_path, quiet):
    path = write_bag(
        tmp_path / "run", bench_records(quiet), "sqlite3", compression="message"
    )
    file = path / "run.db3"
    assert len(import_bag(path).samples) == len(import_bag(file).samples) == 1
    for damage in (lambda: (path / "metadata.yaml").write_text(""), lambda: None):
        damage()
        text = refusal(path)
        assert "compressed one by one (zstd)" in text and "ros2 bag reindex" in text
        assert "needs velocity" not in text
        assert "give the folder of the bag" in refusal(file)
        (path / "metadata.yaml").unlink(missing_ok=True)


def test_compressed_messages_with_an_empty_part(tmp_path, quiet):
    path = write_bag(
        tmp_path / "run", bench_records(quiet), "sqlite3", compression="message"
    )
    (path / "run_1.db3").touch()
    list_files(path, ["run.db3", "run_1.db3"])
    samples, report = import_bag(path)
    assert len(samples) == 1 and report.notes == ("run_1.db3 is empty: left out",)


def test_unknown_compression_is_named(tmp_path, quiet):
    path = write_bag(
        tmp_path / "run", bench_records(quiet), "sqlite3", compression="message"
    )
    change_metadata(path, compression_format="snappy")
    assert "compressed one by one by snappy" in refusal(path)

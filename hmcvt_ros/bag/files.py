# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The files of a bag: which there are, what metadata.yaml says of them, and what damages them.

A recorder that is killed leaves metadata.yaml empty or unwritten and its last file cut off or
empty. So metadata.yaml is read for what the files do not hold themselves (their order, the
compression of messages, the layout of types), and each file is judged alone.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from hmcvt_core import InputError
from hmcvt_core.errors import in_one_line

BAG_FILES = (".mcap", ".db3")
"""Endings of the files that hold messages."""
COMPRESSED = ".zstd"
"""Ending that a compressed file has in addition."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of compressed data (RFC 8878); no message in CDR begins with them."""
METADATA = "metadata.yaml"

_MAGIC = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\x00"}
_MCAP_END = b"\x89MCAP0\r\n"
_VERSION_WITH_FILES = 5
"""Version from which on metadata.yaml also describes each file."""
_LAYOUT = re.compile(r"RIHS01_[0-9a-f]{64}")
_FORMAT = {".mcap": "MCAP", ".db3": "SQLite"}


@dataclass(frozen=True)
class Metadata:
    """What metadata.yaml says, as far as it can be read.

    Attributes:
        files: names of the files in the order of recording.
        message_compression: compression of each message; empty for none.
        layouts: hash of the layout of its type, by topic.
        problem: why it cannot be read, as a clause; empty when it can.
    """

    files: tuple[str, ...] = ()
    message_compression: str = ""
    layouts: Mapping[str, str] = field(default_factory=dict)
    problem: str = ""


@dataclass(frozen=True)
class BagFiles:
    """The files of a bag that are to be read.

    Attributes:
        paths: files in the order of recording.
        metadata: what metadata.yaml says.
        notes: what is missing, as sentences.
        missing: names of files that metadata.yaml lists and that do not exist.
    """

    paths: tuple[Path, ...]
    metadata: Metadata
    notes: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


def is_bag_file(path: Path) -> bool:
    """Whether a name is that of a file with messages, compressed or not."""
    return storage_of(path) in BAG_FILES


def storage_of(path: Path) -> str:
    """Return the ending that names the storage, without that of a compression."""
    if path.suffix == COMPRESSED:
        return Path(path.stem).suffix
    return path.suffix


def files_of(path: Path) -> BagFiles:
    """List the files of a bag.

    Args:
        path: folder of the bag, or one of its files.

    Raises:
        InputError: there is no such bag.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such bag")
    if not path.is_dir():
        return _single_file(path)
    metadata = read_metadata(path / METADATA)
    present = {file.name: file for file in _bag_files_in(path)}
    if not present and not metadata.files:
        raise InputError(f"{path}: {_no_messages(path, metadata)}")
    if metadata.problem and present:
        return BagFiles(
            tuple(present.values()), metadata, _metadata_notes(path, metadata)
        )
    return _listed_files(path, metadata, present)


def read_metadata(path: Path) -> Metadata:
    """Read metadata.yaml; what is wrong with it becomes `problem`."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return Metadata(problem="is missing")
    except UnicodeDecodeError:
        return Metadata(problem="is damaged (no text)")
    if not text.strip(" \n\0"):
        return Metadata(problem="is empty")
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError):
        return Metadata(problem="is damaged (no YAML)")
    information = _mapping(_mapping(content).get("rosbag2_bagfile_information"))
    names = information.get("relative_file_paths")
    if not isinstance(names, list) or not _all_text(names):
        names = []
    return Metadata(
        # Up to version 3 the names begin with that of the folder.
        files=tuple(Path(name).name for name in names),
        message_compression=_message_compression(information),
        layouts=_layouts(information),
        problem=_problem(information, len(names)),
    )


def damage(file: Path, error: Exception | None = None) -> str:
    """Describe why a file cannot be read, with the tool that recovers it.

    Args:
        file: path of a file that could not be opened or read to its end.
        error: what the reader raised.
    """
    name = file.name
    if file.stat().st_size == 0:
        return f"{name} is empty"
    if file.suffix == COMPRESSED:
        return f"{name} cannot be unpacked (zstd -d {name}): {_words(error)}"
    magic = _MAGIC[file.suffix]
    with file.open("rb") as content:
        start = content.read(len(magic))
        content.seek(max(file.stat().st_size - len(_MCAP_END), 0))
        end = content.read()
    if start.startswith(ZSTD_MAGIC):
        return (
            f"{name} is compressed: name it {name}{COMPRESSED}, or unpack it (zstd -d)"
        )
    if start != magic:
        return f"{name} is no {_FORMAT[file.suffix]} file"
    stem = file.stem
    if file.suffix == ".mcap":
        state = "is damaged" if end == _MCAP_END else "is cut off"
        return (
            f"{name} {state} ({_words(error)}); recover what it holds: "
            f"mcap recover {name} -o {stem}_recovered.mcap"
        )
    return (
        f"{name} is cut off or damaged ({_words(error)}); recover what it holds: "
        f"sqlite3 {name} .recover | sqlite3 {stem}_recovered.db3"
    )


def unfinished_journal(file: Path) -> Path | None:
    """Return the journal of a SQLite file that the recorder did not close; None without one.

    It holds messages that are not in the file yet.
    """
    journal = file.with_name(f"{file.name}-wal")
    if file.suffix == ".db3" and journal.is_file() and journal.stat().st_size > 0:
        return journal
    return None


def reindex_hint(folder: Path) -> str:
    """Return the command that writes metadata.yaml again."""
    return f"ros2 bag reindex {folder} writes it again"


def _no_messages(folder: Path, metadata: Metadata) -> str:
    if (folder / METADATA).is_file():
        return (
            f"the bag cannot be read: {METADATA} {metadata.problem}, "
            "and the folder holds no file with messages"
        )
    return (
        f"is no bag: it holds neither {METADATA} nor a file that ends in "
        f"{' or '.join(BAG_FILES)}"
    )


def _single_file(path: Path) -> BagFiles:
    if not is_bag_file(path):
        raise InputError(
            f"{path}: a bag is a folder, or a file that ends in "
            f"{' or '.join(BAG_FILES)}"
        )
    metadata = read_metadata(path.parent / METADATA)
    if path.name in metadata.files:
        return BagFiles((path,), metadata)
    return BagFiles((path,), Metadata(problem="does not describe it"))


def _listed_files(
    folder: Path, metadata: Metadata, present: Mapping[str, Path]
) -> BagFiles:
    paths = []
    missing = []
    for name in metadata.files:
        unpacked = name.removesuffix(COMPRESSED)
        if name in present:
            paths.append(present[name])
        elif unpacked in present:
            paths.append(present[unpacked])
        else:
            missing.append(name)
    if not paths:
        # The files were renamed: read those under their new names.
        notes = (
            f"{METADATA} lists files that are missing ({', '.join(missing)}): the files in "
            f"the folder were read; {reindex_hint(folder)}",
        )
        return BagFiles(tuple(present.values()), metadata, notes, tuple(missing))
    remarks = [f"{name} is missing" for name in missing]
    for name, path in present.items():
        if path not in paths:
            remarks.append(
                f"{name} is not listed in {METADATA} and was not read; "
                f"{reindex_hint(folder)}"
            )
    return BagFiles(tuple(paths), metadata, tuple(remarks), tuple(missing))


def _metadata_notes(folder: Path, metadata: Metadata) -> tuple[str, ...]:
    if metadata.problem in ("", "is missing"):
        # A folder without metadata.yaml is what a killed recorder leaves; nothing is lost.
        return ()
    return (
        f"{METADATA} {metadata.problem}: the files were read one by one; "
        f"{reindex_hint(folder)}",
    )


def _bag_files_in(folder: Path) -> list[Path]:
    """Return the files with messages in the order of recording; unpacked ones come first."""
    files = [file for file in folder.iterdir() if is_bag_file(file)]
    names = {file.name for file in files}
    kept = [
        file for file in files if file.suffix != COMPRESSED or file.stem not in names
    ]
    return sorted(kept, key=_recording_order)


def _recording_order(file: Path) -> tuple[str, int, str]:
    """Sort key of a part: `run_10.mcap` was recorded after `run_9.mcap`."""
    stem = Path(file.name.removesuffix(COMPRESSED)).stem
    name, number = re.fullmatch(r"(.*?)(?:_(\d+))?", stem).groups()  # type: ignore[union-attr]
    # A file without a number comes first.
    return name, -1 if number is None else int(number), file.name


def _problem(information: Mapping[str, Any], names: int) -> str:
    """Return what is wrong with the content of metadata.yaml that lists some names of files."""
    if names == 0:
        return "is damaged (it lists no files)"
    version = information.get("version")
    if version is None:
        return "is cut off"
    if isinstance(version, int) and version >= _VERSION_WITH_FILES:
        entries = information.get("files")
        if not isinstance(entries, list) or len(entries) not in (0, names):
            return "is cut off (its list of files is incomplete)"
    return ""


def _all_text(names: list[Any]) -> bool:
    return bool(names) and all(isinstance(name, str) for name in names)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _message_compression(information: Mapping[str, Any]) -> str:
    if str(information.get("compression_mode", "")).lower() != "message":
        return ""
    return str(information.get("compression_format") or "an unknown format")


def _layouts(information: Mapping[str, Any]) -> dict[str, str]:
    entries = information.get("topics_with_message_count")
    layouts = {}
    for entry in entries if isinstance(entries, list) else ():
        topic = _mapping(_mapping(entry).get("topic_metadata"))
        layout = topic.get("type_description_hash")
        if isinstance(layout, str) and _LAYOUT.fullmatch(layout):
            layouts[str(topic.get("name"))] = layout
    return layouts


def _words(error: Exception | None) -> str:
    """Return what a library says of an error, without its full stop."""
    if error is None:
        return "unknown error"
    return in_one_line(error).rstrip(".")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Files as text: encodings, rows of cells, and formats that are no text."""

import csv
import hashlib
import io
import os
import re
from contextlib import suppress
from pathlib import Path

from ..errors import InputError

_MAX_BYTES = 256 * 1024 * 1024
# First bytes of a file, what it is, and what reads it.
_BINARY = (
    (b"PAR1", "a Parquet file", "pandas.read_parquet(...).to_csv(...)"),
    (b"MDF ", "an MDF file (.mf4, .mdf, .dat)", "asammdf: mdf.export('csv')"),
    (b"UnFinMF ", "an MDF file that was not closed", "asammdf: mdf.export('csv')"),
    (b"TDSm", "a TDMS file of LabVIEW", "npTDMS: tdmsinfo, TdmsFile.as_dataframe()"),
    (
        b"TDSh",
        "the index of a TDMS file",
        "the .tdms file of the same name, with npTDMS",
    ),
    (b"LOGG", "a BLF file of a CAN log", "python-can and cantools with the .dbc"),
    (
        b"MATLAB 5.0",
        "a MAT file of MATLAB",
        "scipy.io.loadmat, or writetable in MATLAB",
    ),
    (b"\x89HDF", "an HDF5 file (also .mat 7.3)", "h5py or pandas.read_hdf"),
    (b"ARROW1", "a Feather file", "pandas.read_feather(...).to_csv(...)"),
    (b"SQLite format 3", "an SQLite data base", "sqlite3 or pandas.read_sql"),
    (b"\x89MCAP", "an MCAP recording", "hmcvt import-bag"),
    (b"#ROSBAG", "a ROS 1 bag", "rosbags-convert, then hmcvt import-bag"),
    (b"\x1f\x8b", "a gzip archive", "gunzip, then hmcvt import"),
    (b"7z\xbc\xaf", "a 7z archive", "7z x, then hmcvt import"),
    (b"%PDF", "a PDF", "a table saved as CSV or Excel"),
    (b"<!DOCTYPE", "a web page", "a table saved as CSV or Excel"),
    (b"<html", "a web page", "a table saved as CSV or Excel"),
)


def read_bytes(path: Path) -> tuple[bytes, str]:
    """Return the content of a file and its SHA-256.

    Raises:
        InputError: the file cannot be read or is too large.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(
                f"{path}: larger than {_MAX_BYTES >> 20} MiB, not a bench log"
            )
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from None
    return raw, hashlib.sha256(raw).hexdigest()


def refuse_binary(path: Path, raw: bytes) -> None:
    """Raise an `InputError` that names a binary format and what reads it."""
    for start, name, reader in _BINARY:
        if raw[: len(start)].lower() == start.lower():
            raise InputError(
                f"{path}: is {name}, which holds no text: convert it to CSV with "
                f"{reader}"
            )


def read_text(path: str | os.PathLike[str], utf_16: bool = False) -> tuple[str, str]:
    """Return the text of a file and its SHA-256.

    Args:
        path: of the file.
        utf_16: whether to read UTF-16 too, as some programs export "Unicode text".

    Raises:
        InputError: the file cannot be read, is too large, or holds no text.
    """
    raw, sha256 = read_bytes(Path(path))
    refuse_binary(Path(path), raw)
    text = decoded(raw, path, utf_16)
    # A lone carriage return ends a line too: of old programs, and of spreadsheets on a Mac.
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text, sha256


def decoded(raw: bytes, path: str | os.PathLike[str], utf_16: bool) -> str:
    """Return the text of a file: UTF-8, or else a legacy encoding.

    Args:
        raw: content of the file.
        path: of the file, for messages.
        utf_16: whether to read UTF-16 too.

    Raises:
        InputError: the file holds no text.
    """
    if utf_16 and raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        with suppress(UnicodeDecodeError):
            return raw.decode("utf-16")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\0" in raw:
            raise InputError(
                f"{path}: not UTF-8 text at byte {error.start}: save it as 'CSV UTF-8'"
            ) from None
    with suppress(UnicodeDecodeError):
        chinese = raw.decode("gb18030")
        if re.search(
            "[\u8f6c\u626d\u6548\u529f\u6e29\u538b][\u901f\u77e9\u7387\u5ea6\u529b]",
            chinese,
        ):
            return chinese
    return raw.decode("cp1252", "replace")


def split_rows(text: str, separator: str, source: str) -> list[list[str]]:
    """Cut text into cells without blanks around them.

    Args:
        text: of the file.
        separator: one of `SEPARATORS`.
        source: name of the file, for messages.

    Raises:
        InputError: quotation marks do not match.
    """
    if not separator:
        return [re.split(r"\s+", line.strip()) for line in text.splitlines()]
    has_dashes = any(dash in text for dash in _DASHES)
    reader = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
    try:
        rows = [list(map(str.strip, row)) for row in reader]
    except csv.Error as error:
        raise InputError(f"{source}: not CSV: {error}") from None
    if has_dashes:
        rows = [list(map(_plain_minus, row)) for row in rows]
    return rows


_DASHES = ("\u2212", "\u2013")


def _plain_minus(cell: str) -> str:
    """Write a typographic minus or a dash in front of a number as the sign that Python reads."""
    return re.sub(r"^[\u2212\u2013](?=[\d.,])", "-", cell)

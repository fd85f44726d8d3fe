# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random damage to the files of a bag: the right sample or one line, never another value."""

import random
import shutil

import pytest

from hmcvt_core.errors import InputError
from hmcvt_ros.bag import import_bag

from .simulated import bench_records, write_bag

KINDS = [
    (storage, compression)
    for storage in ("mcap", "sqlite3")
    for compression in (None, "file", "message")
]


def cut_off(rng, file):
    content = file.read_bytes()
    file.write_bytes(content[: rng.randint(0, len(content))])


def flip_bits(rng, file):
    content = bytearray(file.read_bytes())
    for _ in range(rng.randint(1, 5)):
        content[rng.randrange(len(content))] ^= 1 << rng.randint(0, 7)
    file.write_bytes(content)


def erase_a_stretch(rng, file):
    content = bytearray(file.read_bytes())
    start = rng.randrange(len(content))
    length = min(rng.randint(1, 3000), len(content) - start)
    content[start : start + length] = bytes(length)
    file.write_bytes(content)


def empty(rng, file):
    file.write_bytes(b"")


def replace(rng, file):
    file.write_bytes(rng.randbytes(rng.randint(1, 5000)))


def remove(rng, file):
    file.unlink()


def rename(rng, file):
    file.rename(file.with_name(f"x{file.name}"))


DAMAGES = (cut_off, flip_bits, erase_a_stretch, empty, replace, remove, rename)


@pytest.mark.parametrize("trials", [15, pytest.param(40, marks=pytest.mark.long)])
@pytest.mark.parametrize(("storage", "compression"), KINDS)
def test_random_damage_changes_no_value(tmp_path, quiet, storage, compression, trials):
    whole = write_bag(
        tmp_path / "whole", bench_records(quiet), storage, compression=compression
    )
    rng = random.Random(f"{storage} {compression}")
    for number in range(trials):
        bag = shutil.copytree(whole, tmp_path / f"bag{number}")
        file = rng.choice(sorted(bag.iterdir()))
        damage = rng.choice(DAMAGES)
        damage(rng, file)
        where = f"{damage.__name__} of {file.name}, trial {number}"
        try:
            samples, _ = import_bag(bag)
        except InputError as error:
            assert str(error).startswith(str(bag)) and "\n" not in str(error), where
        else:
            assert samples.load_torque == pytest.approx([200.0], rel=1e-3), where
            assert samples.engine_speed == pytest.approx([120.0], rel=1e-3), where

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A small sample of random cycles, engine maps and vehicle files."""

import numpy as np
import pytest

from studies.inputs import damage
from studies.inputs.__main__ import KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_no_input_is_read_wrong_without_a_word(tmp_path, kind):
    draw, judge = KINDS[kind]
    read = 0
    for index in range(40):
        drawn = draw(np.random.default_rng([1, index]), tmp_path)
        judged = judge(drawn)
        assert judged.wrong == "", drawn.path.read_text()
        read += not judged.refused
    assert read >= 8


@pytest.mark.parametrize("index", range(len(damage.KINDS)))
def test_damaged_files_end_in_a_message(tmp_path, index):
    kind = damage.KINDS[index]
    for number in range(4):
        rng = np.random.default_rng([2, index, number])
        path, options = damage.draw(rng, kind, tmp_path)
        path.write_bytes(damage.damaged(rng, path.read_bytes()))
        assert damage.read(kind, path, options) == ""

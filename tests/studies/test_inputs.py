# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A small sample of random cycles, engine maps and vehicle files."""

import numpy as np
import pytest

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

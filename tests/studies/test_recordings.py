# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A small sample of the random recordings."""

import numpy as np
import pytest

from studies.recordings.__main__ import judge
from studies.recordings.files import random_recording

for package in ("asammdf", "nptdms", "can", "cantools"):
    pytest.importorskip(package)


@pytest.mark.parametrize("index", range(12))
def test_no_recording_is_wrong_without_a_word(tmp_path, index):
    recording = random_recording(np.random.default_rng([1, index]), tmp_path)
    outcome = judge(recording, tmp_path)
    assert outcome.wrong == "", recording.features
    if not recording.must_ask:
        assert outcome.code == 0, outcome.message

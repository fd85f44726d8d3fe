# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Wrong arguments of Python are refused by an InputError, not by an error from inside."""

import numpy as np
import pytest

import hmcvt_core as hmcvt


def test_a_mask_of_another_length_is_refused(table2):
    with pytest.raises(hmcvt.InputError, match=r"select of \d+ samples: boolean index"):
        table2.select(np.array([True, False]))
    with pytest.raises(hmcvt.InputError, match="out of bounds"):
        table2.select([1000])

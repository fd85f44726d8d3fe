# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import pytest

from hmcvt_tools.report import gap_map


@pytest.fixture(scope="module")
def coarse_maps():
    """Draw maps of 169 points each; the 625 of a page take a third of its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gap_map, "_GRID", 13)
        yield

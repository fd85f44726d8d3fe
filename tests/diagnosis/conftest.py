# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
import os

import pytest

from . import campaigns


@pytest.fixture(scope="session", autouse=True)
def share_diagnoses(tmp_path_factory):
    if "PYTEST_XDIST_WORKER" in os.environ:
        # The folders of all workers lie in one, which is of this run.
        campaigns.folder = tmp_path_factory.getbasetemp().parent

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The paper's bench tests and stage, and one fixed stream of examples for hypothesis."""

import numpy as np
import pytest
from hypothesis import settings

import hmcvt_core as hmcvt

settings.register_profile(
    "hmcvt", derandomize=True, database=None, deadline=None, max_examples=60
)
settings.load_profile("hmcvt")

FIT = np.array([1, 2, 4, 5, 6]) - 1  # section 4.2
HELD_BACK = np.array([3, 7, 8]) - 1


def assert_refused(load, path, message):
    """One short line that begins with the file."""
    with pytest.raises(hmcvt.InputError, match=message) as caught:
        load(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ") and text.count(str(path)) == 1
    assert len(text.splitlines()) == 1 and len(text) <= 1000


@pytest.fixture(scope="session")
def hm4():
    return hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))


@pytest.fixture(scope="session")
def fitted(table2):
    """The paper's split, power balance."""
    return hmcvt.identify(table2.select(FIT), holdout=table2.select(HELD_BACK))


@pytest.fixture(scope="session")
def fitted_published(table2):
    """The paper's split, the paper's formulas."""
    return hmcvt.identify(
        table2.select(FIT), holdout=table2.select(HELD_BACK), formulation="published"
    )


@pytest.fixture(scope="session")
def model(fitted):
    return fitted.model

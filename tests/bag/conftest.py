# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A simulated bench. These tests need the extra `bag`; without it they are left out, and say so."""

import importlib.util

import numpy as np
import pytest

import hmcvt_core

MISSING = importlib.util.find_spec("rosbags") is None

if MISSING:
    collect_ignore_glob = ["test_*.py"]
else:
    from .simulated import run_bench

PLAN = np.array(
    [
        (ratio, speed, load)
        for ratio in (-0.8, 0.3, 0.9)
        for speed in (85.0, 140.0)
        for load in (120.0, 280.0)
    ]
)


def pytest_terminal_summary(terminalreporter):
    if MISSING:
        terminalreporter.write_line("tests/bag left out: rosbags is not installed")


@pytest.fixture(scope="session")
def model():
    """The truth of the simulated bench."""
    return hmcvt_core.load_model(hmcvt_core.data_path("params/hm4.yaml"))


@pytest.fixture(scope="session")
def plan():
    """Operating points in an order that makes every step large."""
    return PLAN[np.random.default_rng(3).permutation(len(PLAN))]


@pytest.fixture(scope="session")
def bench(model, plan):
    return run_bench(model, plan)


@pytest.fixture(scope="session")
def quiet(model):
    """Eight seconds at one point, without noise to speak of."""
    return run_bench(model, [(0.5, 120.0, 200.0)], hold=8.0, noise=1e-5)

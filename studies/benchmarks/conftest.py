# SPDX-License-Identifier: Apache-2.0
"""The shipped model, and the clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import hmcvt_core as hmcvt

ROUNDS = 5


@pytest.fixture(scope="session")
def model() -> hmcvt.EfficiencyModel:
    return hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))


@pytest.fixture
def timed(benchmark: Any) -> Callable[..., Any]:
    """Time a function of `calls` calls: several rounds, of which the record takes the fastest.

    Whatever else is to be told goes into the record beside the times.
    """
    def run(function: Callable[[], Any], calls: int = 1, rounds: int = ROUNDS,
            warm: bool = True, **told: Any) -> Any:
        benchmark.extra_info.update(calls=calls, **told)
        return benchmark.pedantic(function, rounds=rounds, warmup_rounds=int(warm))

    run.told = benchmark.extra_info  # type: ignore[attr-defined]
    return run

# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of a batch of lookups: counted while it runs, then done alone.

`Counted` arrays note every array operation that they enter. Done again on arrays that are at hand,
the same operations take the time that NumPy needs for them and nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from hmcvt_core import EfficiencyModel
from hmcvt_core.physics import steady_state
from hmcvt_core.transmission import ranges
from hmcvt_core.transmission.points import OperatingPoints


class Operation(NamedTuple):
    """A NumPy function, the way it is called, the types of its operands, and their length.

    The type of a single number is empty.
    """

    function: Any
    method: str
    kinds: tuple[str, ...]
    size: int


class Counted(np.ndarray):  # type: ignore[type-arg]
    """An array that notes what is done with it in the list `done`."""

    done: list[Operation]

    def __array_finalize__(self, other: Any) -> None:
        self.done = getattr(other, "done", [])

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        return self._note(ufunc, method, inputs, options)

    def __array_function__(self, function: Any, types: Any, inputs: Any, options: Any) -> Any:
        if function is np.where:
            return self._note(function, "__call__", inputs, options)
        return super().__array_function__(function, types, inputs, options)

    def _note(self, function: Any, method: str, inputs: Sequence[Any], options: Any) -> Any:
        plain = [np.asarray(item) if isinstance(item, Counted) else item for item in inputs]
        call = function if method == "__call__" else getattr(function, method)
        result = call(*plain, **options)
        kinds = tuple(item.dtype.char if np.ndim(item) else "" for item in plain)
        self.done.append(Operation(function, method, kinds, max(map(np.size, plain))))
        if not isinstance(result, np.ndarray):
            return result
        found = result.view(Counted)
        found.done = self.done
        return found


def counted(model: EfficiencyModel, point: Sequence[NDArray[np.float64]]) -> list[Operation]:
    """Look up the efficiency at points, range checks included; return the operations."""
    done: list[Operation] = []
    arrays = []
    for values in point:
        array = values.view(Counted)
        array.done = done
        arrays.append(array)
    # np.asarray would take the counter off.
    patient = SimpleNamespace(**{**vars(np), "asarray": np.asanyarray})
    with (mock.patch.object(steady_state, "np", patient),
          mock.patch.object(ranges, "np", patient)):
        for limits, array in zip(ranges.POINT_RANGES, arrays, strict=True):
            limits.check(array)
        solver = steady_state.ArraySolver(model.stage, model.parameters)
        solver.solve(OperatingPoints(*arrays))
    return done


def per_point(done: Sequence[Operation], count: int) -> dict[str, float]:
    """Return the operations per point by name, most frequent first."""
    total: Counter[str] = Counter()
    for function, method, _, size in done:
        name = function.__name__ + ("" if method == "__call__" else f" {method}")
        total[name] += size
    return {name: size / count for name, size in total.most_common()}


def alone(done: Sequence[Operation]) -> Callable[[], None]:
    """Return what does the same operations, on numbers that are at hand."""
    rng = np.random.default_rng(0)
    longest = max(size for *_, size in done)
    numbers = {"d": [rng.uniform(1.0, 2.0, longest) for _ in range(3)],
               "?": [rng.random(longest) < 0.5 for _ in range(3)]}
    calls = []
    for function, method, kinds, size in done:
        operands = [numbers[kind][i][:size] if kind else 2.0
                    for i, kind in enumerate(kinds)]
        calls.append((function if method == "__call__" else getattr(function, method), operands))

    def run() -> None:
        for call, operands in calls:
            call(*operands)

    return run

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""An FMU as a function of operating points, for `hmcvt_core.Simulator` (extra `export`)."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from hmcvt_core.diagnosis.system import Array, Points
from hmcvt_core.errors import InputError


class FmuFunction:
    """A function that runs an FMU at operating points and returns its outputs at the end.

    Each point is a simulation of its own, from the start of the FMU to `stop_time`. The function
    may be `Simulator.function`: parameters and effects are then parameters of the FMU.

    Args:
        path: of the FMU, version 2 or 3, for co-simulation or model exchange.
        outputs: channels to return.
        stop_time: when the outputs are read [s]; long enough to settle.
        variables: names that differ in the FMU, by the name of axis, channel or argument.

    Raises:
        InputError: FMPy is missing, the FMU cannot be loaded here, or has no such output.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        outputs: Sequence[str],
        *,
        stop_time: float = 1.0,
        variables: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        try:
            import fmpy
            from fmpy.simulation import instantiate_fmu
        except ImportError as error:
            raise InputError(
                'an FMU needs FMPy: pip install "hmcvt_ros[export]"'
            ) from error
        self.path = Path(path)
        self.outputs = tuple(outputs)
        self.stop_time = stop_time
        self.variables = dict(variables)
        self._folder = tempfile.mkdtemp(prefix="hmcvt-fmu-")
        self._cleaner = weakref.finalize(self, shutil.rmtree, self._folder, True)
        try:
            fmpy.extract(str(self.path), unzipdir=self._folder)
            self._description = fmpy.read_model_description(self._folder)
            self._instance = instantiate_fmu(self._folder, self._description)
        except Exception as error:  # of the archive, the description or the library
            raise InputError(
                f"{self.path}: cannot be loaded: {type(error).__name__}: {error}"
            ) from error
        self._known = {item.name for item in self._description.modelVariables}
        for name in self.outputs:
            self._variable(name)

    def _variable(self, name: str) -> str:
        """Return the variable of the FMU for an axis, channel or argument."""
        variable = self.variables.get(name, name)
        if variable not in self._known:
            raise InputError(f"{self.path}: has no variable {variable}")
        return variable

    def __call__(self, points: Points, **arguments: float) -> dict[str, Array]:
        """Return the outputs at n points, shape (n,) each; NaN where the FMU fails.

        Args:
            points: inputs by name, shape (n,) each.
            arguments: parameters by name.

        Raises:
            InputError: no such variable, or the FMU fails at every point.
        """
        parameters = {self._variable(name): value for name, value in arguments.items()}
        inputs = {self._variable(name): values for name, values in points.items()}
        count = len(next(iter(points.values())))
        rows = np.full((count, len(self.outputs)), np.nan)
        failures = []
        for i in range(count):
            at = {name: float(values[i]) for name, values in inputs.items()}
            try:
                rows[i] = self._run({**parameters, **at})
            except Exception as error:  # of the FMU
                failures.append(error)
        if len(failures) == count:
            raise InputError(f"{self.path}: fails at every point: {failures[0]}")
        return dict(zip(self.outputs, rows.T, strict=True))

    def _run(self, start_values: Mapping[str, Any]) -> list[float]:
        from fmpy import simulate_fmu

        self._instance.reset()
        result = simulate_fmu(
            self._folder,
            validate=False,
            stop_time=self.stop_time,
            output_interval=self.stop_time,
            start_values=dict(start_values),
            output=[self._variable(name) for name in self.outputs],
            model_description=self._description,
            fmu_instance=self._instance,
        )
        return [float(result[self._variable(name)][-1]) for name in self.outputs]

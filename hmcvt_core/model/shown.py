# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a notebook shows of a model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..files import drawing, preformatted
from ..files.bench import BenchSamples
from ..transmission.parameters import HydraulicParameters


class Shown:
    """Of a model: a picture when asked for, its parameters as text."""

    parameters: HydraulicParameters
    formulation: str
    standard_errors: Mapping[str, float]

    def plot_map(self, power: float = 40e3, samples: BenchSamples | None = None) -> Any:
        """Return a matplotlib figure of the efficiency at an output power [W], tests marked."""
        return drawing().drawn(lambda figure: drawing().draw_surface(
            figure, self, power, samples=samples))

    def _repr_html_(self) -> str:
        values = self.parameters.to_mapping(self.standard_errors).items()
        return preformatted("\n".join([self.formulation, *(
            f"  {name:<14} {entry['value']:.4g} {entry['unit']}" for name, entry in values)]))

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the power goes: the losses of every part at operating points."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..files import picture, plain
from ..transmission.ranges import Array


@dataclass(frozen=True)
class Breakdown:
    """Power in, power out and every loss between them [W]; arrays of one shape.

    Attributes:
        input_power: from the engine.
        output_power: to the load.
        losses: by part: `gear_pair_<name>`, `leakage`, `pump_damping`, `pump_friction`,
            `motor_damping`, `motor_friction`, `planetary_row`, and the name of each effect that
            drags a shaft. Their sum is input_power - output_power.
        stage: name of the stage engaged.
    """

    input_power: Array
    output_power: Array
    losses: Mapping[str, Array]
    stage: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the powers as plain data for JSON; None where there is no answer."""
        return dict(plain(vars(self)))

    def mean_losses(self) -> dict[str, float]:
        """Return part -> mean loss over the points with an answer [W], the largest first."""
        means = {}
        for part, watts in self.losses.items():
            means[part] = _mean(watts)
        return dict(sorted(means.items(), key=lambda entry: -entry[1]))

    def report(self) -> str:
        """Return the powers as text; of several points the means over those with an answer."""
        count = int(np.size(self.input_power))
        answered = int(np.isfinite(self.input_power).sum())
        heading = f"stage {self.stage}" if self.stage else "lost power"
        if count > 1:
            heading = f"{heading}, mean of {answered} of {count} points"
        if not answered:
            return f"{heading}: no answer"
        rows = {
            "from the engine": _mean(self.input_power),
            **self.mean_losses(),
            "to the load": _mean(self.output_power),
        }
        lines = [heading]
        for name, watts in rows.items():
            lines.append(f"{name.replace('_', ' '):<18} {round(watts):9d} W")
        return "\n".join(lines)

    def plot(self, ax: Any = None) -> Any:
        """Draw the loss of each part; of several points the means.

        Args:
            ax: matplotlib axes to draw on; a new figure when left out.

        Returns:
            The matplotlib figure.
        """
        return picture(self, ax=ax)


def _mean(watts: Array) -> float:
    """Return the mean over the points with an answer [W]; NaN where there is none."""
    values = np.asarray(watts, dtype=float)
    answered = values[np.isfinite(values)]
    return float(answered.mean()) if answered.size else float("nan")

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A diagnosis as users get it: values, text, plain data and a picture."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

from ...files import picture, preformatted
from ..statements.agreement import Agreement
from .outcome import Outcome
from .text import report

_NOT_IN_JSON = (
    "limits",
    "point",
    "setting",
    "model",
    "has_fixed_shapes",
    "may_be_absent",
)
"""Fields that plain data gives axis by axis, or not at all."""


class Diagnosis(Outcome):
    """Outcome of a diagnosis: see `Outcome` for its fields."""

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON object of `hmcvt diagnose --json`."""
        nowhere = {axis.name: None for axis in self.axes}
        data = {
            "gap": _fields(self.gap),
            "where": [
                {**region.limits, **region.setting, **_fields(region)}
                for region in self.where
            ],
            "component": self.component,
            "verdict": self.verdict,
            "causes": [_fields(cause) for cause in self.causes],
            "sets": [_fields(item) for item in self.sets],
            "members": [_fields(item) for item in self.members],
            "agreement": _agreement(self.agreement),
            "scatter": None if self.scatter is None else _fields(self.scatter),
            "classes": [item.to_dict() for item in self.classes],
            "unlisted_probability": self.unlisted,
            "shrinkage": _fields(self.shrinkage),
            "delivered": _fields(self.delivered),
            "next_tests": [
                {**(test.point or nowhere), **test.setting, **_fields(test)}
                for test in self.next_tests
            ],
            "advice": self.advice.to_dict(),
            "notes": self.notes,
            "parameters": {
                name: _fields(estimate) for name, estimate in self.parameters.items()
            },
            "shared_errors": [_fields(item) for item in self.shared_errors],
            "seed": self.seed,
        }
        return dict(json.loads(json.dumps(data)))

    def report(self) -> str:
        """Return the outcome as text for a person, at most 100 columns wide."""
        return report(self)

    def plot(self, ax: Any = None, *, of: str = "residuals") -> Any:
        """Draw the residuals before and after, or the maps of the estimated gap.

        Args:
            ax: matplotlib Axes to draw into: the residuals after where a cause is named, else
                those before; or the first map. None makes a figure of all.
            of: `residuals`, or `gap` for `gap_at` with its standard deviation over every pair of
                axes.

        Returns:
            The matplotlib figure.

        Raises:
            InputError: `of` names no picture, the gap has one axis alone, or matplotlib is missing.
        """
        return picture(self, of=of, ax=ax)

    def _repr_html_(self) -> str:
        return preformatted(self.report())


def _agreement(agreement: Agreement) -> dict[str, Any]:
    looks = [_fields(look) for look in agreement.looks]
    return {**_fields(agreement), "looks": looks}


def _fields(value: Any) -> dict[str, Any]:
    """Return the fields of a value as plain data has them."""
    return {
        item.name: getattr(value, item.name)
        for item in fields(value)
        if item.name not in _NOT_IN_JSON
    }

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is known of the errors of a bus, and how finely a log is evaluated."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ..errors import InputError


@dataclass(frozen=True)
class EstimateSettings:
    """Errors of the signals of a bus; each is a standard deviation.

    Attributes:
        step: least distance of two rows [s]; 0.1 is 10 Hz.
        torque_bias: of the engine torque that a bus states, a fraction. Engine makers state 2 to
            5 % at rated speed; the same over the whole log.
        fuel_bias: of the torque that follows from the fuel rate, a fraction: 3 % for the map of
            another engine of the type, the density of the fuel and the meter.
        delay: by which messages may be late against each other [s], uniform from 0.
        engine_inertia: of all that turns with the engine [kg m2]; a tractor's diesel of 6 to 7 L
            with flywheel and pump drives has 1 to 3.
        inertia_error: of `engine_inertia`, a fraction.
        form_error: of the efficiency [-] where the model states no errors of its parameters;
            1.12 % is the paper's uncertainty of a test.

    Raises:
        InputError: a value is no finite number, or negative.
    """

    step: float = 0.1
    torque_bias: float = 0.02
    fuel_bias: float = 0.03
    delay: float = 0.05
    engine_inertia: float = 2.0
    inertia_error: float = 0.5
    form_error: float = 0.0112

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(
                    f"{item.name} = {value:g}: a number of at least 0 is needed"
                )

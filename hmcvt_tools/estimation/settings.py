# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What is known of the errors of a bus, and how finely a log is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from hmcvt_core.errors import InputError
from hmcvt_core.transmission.quantities import real_numbers
from hmcvt_core.transmission.ranges import OIL_TEMPERATURE

WEAR_IN_USE = 1.0
"""Growth of the leakage in the life of a piston unit, a fraction: a drain flow that has doubled is
the sign to change the unit, which still works well (hydraulicspneumatics.com, "Case drain"). Such
units last 10,000 to 20,000 h (Casey, machinerylubrication.com, "How to develop a hydraulic pump
change-out strategy"), so that a thousand hours are 0.05 to 0.1 of it."""


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
        wear: by which part the leakage may have grown since the identification: it is taken as
            halfway, with that half as standard deviation, so that the interval holds at both ends;
            0 where the machine is as identified.
        hydraulics_low: least power that pumps at the engine take and the bus does not state [W].
        hydraulics_high: most of it; the middle is taken off, with half the range as standard
            deviation.
        oil_temperature: at which the model was identified [deg C]; None takes what its provenance
            states.

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
    wear: float = WEAR_IN_USE
    hydraulics_low: float = 0.0
    hydraulics_high: float = 0.0
    oil_temperature: float | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "oil_temperature":
                if value is not None:
                    OIL_TEMPERATURE.check(value, "settings")
                continue
            number = real_numbers(value, item.name)
            if not (np.isfinite(number) & (number >= 0.0)).all():
                raise InputError(
                    f"{item.name} = {value}: a number of at least 0 is needed"
                )
        if self.hydraulics_low > self.hydraulics_high:
            raise InputError(
                f"hydraulics = {self.hydraulics_low:g} to {self.hydraulics_high:g} W: needs two "
                "rising numbers"
            )

    @property
    def hydraulics(self) -> tuple[float, float]:
        """Middle and half the range of the power of working hydraulics [W]."""
        middle = 0.5 * (self.hydraulics_low + self.hydraulics_high)
        return middle, self.hydraulics_high - middle

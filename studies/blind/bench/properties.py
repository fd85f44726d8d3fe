# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a bench is like: properties that are switched on and off one by one."""

from dataclasses import dataclass, fields, replace

from hmcvt_core.errors import InputError


@dataclass(frozen=True)
class Bench:
    """Properties of a bench; with all of them off, readings are those of the exact base.

    Attributes:
        order: tests follow a plan by speed or stroke, as an engineer makes them; off: shuffled.
        sessions: two to six sessions with gaps between them; off: one session.
        zero: every session has its zero of either torque meter, 0.05 to 0.1 % of full scale.
        gain: every session has its gain of either torque meter, 0.05 to 0.1 %.
        drift: zeros move slowly within a session, 0.03 % of full scale.
        hysteresis: a torque that fell to a test reads higher than one that rose, by 0.02 to 0.05 %
            of full scale.
        noise: readings of torque scatter by 0.01 to 0.05 % of full scale; off: no scatter.
        range_noise: that scatter is the same at every torque; off: the same mean scatter of the
            efficiency, evenly over all tests.
        speed_noise: readings of speed scatter by 0.02 %.
        texture: the losses differ from their form by a smooth field of 0.05 to 0.15 points.
        warming: the oil warms with the losses; off: its temperature is set at random.
        plans: grids, power hyperbolas, sweeps or random points; off: random points.
        layouts: several stages and an output-coupled one occur; off: stage HM4 alone.
        statement: the column of the noise stated; off: it is missing.
        record: the columns of session and time; off: they are missing.
        temperature: half of the campaigns log the oil temperature; off: only where the
            effect `oil_temperature` is hidden.
    """

    order: bool = True
    sessions: bool = True
    zero: bool = True
    gain: bool = True
    drift: bool = True
    hysteresis: bool = True
    noise: bool = True
    range_noise: bool = True
    speed_noise: bool = True
    texture: bool = True
    warming: bool = True
    plans: bool = True
    layouts: bool = True
    statement: bool = True
    record: bool = True
    temperature: bool = True

    def without(self, *names: str) -> "Bench":
        """Return the bench with some properties switched off.

        Raises:
            InputError: a property does not exist.
        """
        for name in names:
            if name not in PROPERTIES:
                raise InputError(
                    f"property {name!r} does not exist, expected one of {PROPERTIES}"
                )
        return replace(self, **dict.fromkeys(names, False))


#: Names of the properties.
PROPERTIES = tuple(field.name for field in fields(Bench))

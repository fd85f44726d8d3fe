# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Axes and channels of a transmission bench, with the noise expected of each channel."""

from ...diagnosis.system import Array, Axis, Channel
from ...transmission import ranges
from ...transmission.quantities import PREDICTED

DISPLACEMENT_RATIO = Axis(
    name="displacement_ratio",
    unit="-",
    word="displacement ratio",
    heading="stroke",
    digits=2,
    tolerance=0.001,
    graded=False,
    test_format="stroke {0:+.2f}",
)
ENGINE_SPEED = Axis(
    name="engine_speed",
    unit="rad/s",
    word="engine speed",
    heading="speed [rad/s]",
    digits=1,
    tolerance=ranges.RPM,
    test_format="{0:.1f} rad/s ({1:.0f} r/min)",
    second_unit_factor=1.0 / ranges.RPM,
)
LOAD_TORQUE = Axis(
    name="load_torque",
    unit="N m",
    word="load",
    heading="load [N m]",
    digits=0,
    tolerance=0.2,
    test_format="{0:.0f} N m",
)
AXES = (DISPLACEMENT_RATIO, ENGINE_SPEED, LOAD_TORQUE)
"""What a test sets."""

OIL_TEMPERATURE = Axis(
    name="oil_temperature",
    unit="deg C",
    word="oil temperature",
    heading="oil [deg C]",
    digits=0,
    tolerance=1.0,
    steered=False,
)
STAGE = Axis(
    name="stage",
    unit="-",
    word="stage",
    heading="stage",
    digits=0,
    tolerance=0.1,
    steered=False,
)
"""Index of the engaged stage among the stages of the model."""

CHANNELS = tuple(
    Channel(name=quantity.name, **vars(quantity.channel)) for quantity in PREDICTED
)
"""The quantities that the model predicts and a bench may read; the gap is in the first."""
EFFICIENCY_CHANNEL = CHANNELS[0]


def by_name(rows: Array) -> dict[str, Array]:
    """Return rows of all channels, shape (channels, ...), by the name of the channel."""
    return dict(zip((channel.name for channel in CHANNELS), rows, strict=True))

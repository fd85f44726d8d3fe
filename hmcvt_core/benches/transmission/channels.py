# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Axes and channels of a transmission bench, with the noise expected of each channel."""

from ...diagnosis.system import Axis, Channel
from ...transmission import ranges
from ...transmission.parameters import PAPER_EFFICIENCY_UNCERTAINTY

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

EFFICIENCY_CHANNEL = Channel(
    name="efficiency",
    unit="points",
    factor=100.0,
    digits=2,
    uncertainty=PAPER_EFFICIENCY_UNCERTAINTY,
    relative=False,
    field_spreads=(0.003, 0.01, 0.03),
    step_spreads=(0.01, 0.03),
    misfit_spread=0.0012,
)
# Speed losses are relative, as the noise is. At the same load a speed loss raises the torque by
# the same fraction, so that it lowers the efficiency too.
OUTPUT_SPEED_CHANNEL = Channel(
    name="output_speed",
    unit="rad/s",
    factor=1.0,
    digits=2,
    uncertainty=0.001,
    relative=True,
    field_spreads=(0.001, 0.004, 0.016),
    step_spreads=(0.01, 0.03),
    misfit_spread=0.0004,
    served=False,
)
# ISO 4409 class A: 0.5 % of the reading. Near zero a 40 MPa gauge resolves about 0.05 MPa.
PRESSURE_CHANNEL = Channel(
    name="pressure",
    unit="MPa",
    factor=1e-6,
    digits=2,
    uncertainty=0.005,
    relative=False,
    field_spreads=(1e5, 4e5, 1.6e6),
    step_spreads=(4e5, 1.2e6),
    misfit_spread=5e4,
    least=5e4,
    served=False,
)
CHANNELS = (EFFICIENCY_CHANNEL, OUTPUT_SPEED_CHANNEL, PRESSURE_CHANNEL)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Real pumps and motors, where HMCVT_REAL_UNITS names their folder (docs/studies/units.md)."""

import os
from pathlib import Path

import pytest

from hmcvt_core.benches.unit import diagnose_unit
from hmcvt_tools.tables.unit_table import read_unit

FOLDER = Path(os.environ["HMCVT_REAL_UNITS"])


def band(name, kind, unit=None):
    """Fitted below 70 % of the largest pressure, predicted above."""
    samples = read_unit(FOLDER / name, kind=kind, unit=unit)
    return diagnose_unit(*samples.divided("pressure", 0.7), deals=False)


def removed(answer, channel):
    row = answer.rmse[channel]
    return 1.0 - (row["holdout_with_effects"] / row["holdout_base"]) ** 2


def test_pump_beyond_the_fitted_pressures():
    answer = band("pump_asw062.csv", "pump")
    flow = answer.rmse["flow"]
    assert flow["holdout_base"] > 0.5 / 6e4
    assert flow["holdout_with_effects"] < 0.35 / 6e4
    assert removed(answer, "flow") > 0.6 and removed(answer, "torque") > 0.6
    assert not answer.diagnosis.warnings


# The flow of C7 below 70 % of the pressure has two pressures only (docs/studies/real.md).
@pytest.mark.parametrize(("unit", "least_flow"), [("S4D", 0.6), ("C7", 0.0)])
def test_motor_beyond_the_fitted_pressures(unit, least_flow):
    answer = band("motors_s4d_c7.csv", "motor", unit)
    assert removed(answer, "flow") > least_flow and removed(answer, "torque") > 0.6

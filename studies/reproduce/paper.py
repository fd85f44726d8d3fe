# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the paper prints, in the units it prints; nothing of ours."""

from typing import NamedTuple

FITTED_TESTS = (1, 2, 4, 5, 6)
PREDICTED_TESTS = (3, 7, 8)
GEAR_EFFICIENCIES = (1.0, 0.99, 0.98, 0.97, 0.96)
BEST_GEAR_EFFICIENCY = 0.98
ENGINE_SPEEDS = (750.0, 2200.0)  # r/min, figures 3 to 5
LOAD_POWERS = {3: 40e3, 4: 60e3, 5: 80e3}  # W by figure
ROW_EFFICIENCY_AT_REST = 0.8605  # eta_HM at eps = 0
STANDING_LIMIT = 1e-4  # eta_H at eps = 0 is "any nonzero positive" below

# Section 2.2: mean and standard deviation of ten readings, largest error and range of the sensor.
TORQUE_READINGS = (100.4720, 0.8889)  # N m
SPEED_READINGS = (78.6820, 0.5309)  # rad/s
TORQUE_SENSOR = (10.0, 5000.0)  # N m
SPEED_SENSOR = (1.0, 3000.0)  # r/min


class Uncertainties(NamedTuple):
    """Eqs (1)-(3) [%]."""

    torque_random: float = 0.88
    speed_random: float = 0.67
    torque_system: float = 0.12
    speed_system: float = 0.019
    total: float = 1.12


class Errors(NamedTuple):
    """One row of Table 3: mean |predicted - measured| / measured [%]."""

    all_data: float
    identification: float
    prediction: float


TABLE_3 = {
    1.0: Errors(5.35, 2.07, 10.83),
    0.99: Errors(5.41, 1.63, 11.72),
    0.98: Errors(2.06, 2.16, 1.90),
    0.97: Errors(2.37, 2.69, 1.83),
    0.96: Errors(3.31, 3.25, 3.39),
}

TABLE_4 = {
    0.98: (64.30, 69.23, 82.33, 76.60, 63.52, 82.55, 82.56, 82.54),
    0.97: (64.30, 68.73, 81.32, 76.60, 63.43, 80.77, 80.79, 80.73),
}
"""Estimated efficiency at tests 1 to 8 [%], by gear efficiency."""


class Search(NamedTuple):
    """What figure 6 and its text say of one algorithm."""

    error: float
    iterations: int
    seconds: float


FIGURE_6 = {
    "improved SA": Search(0.00039, 12, 0.21),
    "GA": Search(0.0039, 50, 0.47),
    "PSO": Search(0.0042, 50, 0.36),
}
PARTICLES, ITERATIONS = 20, 50

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Gear train: Table 1, eqs (4), (5), (8), and the values that the paper prints from them."""

import csv
from fractions import Fraction

import numpy as np
import pytest
import yaml

import hmcvt_core as hmcvt
from hmcvt_core.physics import published
from hmcvt_core.transmission.stage import speed_ratio

# Table 1, typed here a second time so that a typing error in either place shows.
TABLE_1 = {
    "i1": "1.439", "i2": "0.969", "i3": "1.484", "i4": "0.678", "i5": "1.96", "i6": "0.982",
    "i7": "3.52", "i8": "2.767", "i9": "0.794", "i10": "2.767", "i11": "0.823", "i12": "1.093",
    "k1": "2.56", "k2": "3.56",
}
STROKES = [-1.0, -0.73, 0.0, 0.73, 1.0]


def equation_5(displacement_ratio):
    """Eq. (5) in exact fractions."""
    i = {name: Fraction(value) for name, value in TABLE_1.items()}
    k, eps = i["k1"], Fraction(displacement_ratio)
    return float(((1 + k) * i["i4"] * i["i5"] + eps * i["i2"] * i["i3"])
                 / (k * i["i2"] * i["i3"] * i["i4"] * i["i5"] * i["i6"] * i["i11"]))


def test_table_1_stands_in_the_data_and_in_the_transmission_file():
    with hmcvt.data_path("data/table1.csv").open(encoding="utf-8") as file:
        assert {row["symbol"]: row["value"] for row in csv.DictReader(file)} == TABLE_1
    data = yaml.safe_load(
        hmcvt.data_path("params/transmission.yaml").read_text(encoding="utf-8"))
    assert ({f"i{name}": ratio for name, ratio in data["gear_pairs"].items()}
            | data["planetary_rows"]) == {name: float(value) for name, value in TABLE_1.items()}


def test_paths_of_hm4(hm4):
    # Section 3: mechanical i2, i3 -> carrier of k1; pump i4; motor i5 -> sun; ring -> i6, i11.
    assert [[pair.name for pair in path.gear_pairs]
            for path in (hm4.mechanical, hm4.pump, hm4.motor, hm4.output)] == [
                ["2", "3"], ["4"], ["5"], ["6", "11"]]
    assert (hm4.mechanical_member, hm4.motor_member, hm4.output_member) == (
        "carrier", "sun", "ring")
    assert hm4.planetary_constant == 2.56


def test_speed_ratio_is_equation_5(hm4):
    found = speed_ratio(hm4, np.array(STROKES))
    np.testing.assert_allclose(found, [equation_5(str(eps)) for eps in STROKES], rtol=1e-14)
    # The digits of docs/theory.md
    np.testing.assert_allclose(found, [0.83286, 0.93107, 1.19658, 1.46209, 1.56029], atol=5e-6)


def test_hydraulic_split_ratio(hm4):
    # docs/theory.md, from eq. (8) with i_HM = n_e / n_out.
    found = published.hydraulic_split_ratio(hm4, np.array(STROKES))
    np.testing.assert_allclose(found, [-0.6697, -0.4936, -0.1622, 0.0489, 0.1087], atol=5e-5)


@pytest.mark.parametrize(("gear_efficiency", "total"), [(0.98, 0.8264), (0.97, 0.8096)])
def test_efficiency_at_zero_stroke(hm4, gear_efficiency, total):
    # 0.8605 is the paper's own number (section 4.2): (1 + A) / i_HM of (12) with eta_H -> 0. By
    # hand: (11) then gives a_1 -> 1 and (7) eta_M1 -> 1, so eta_total = 0.8605 eta_gear^2.
    stage = hm4.with_gear_efficiency(gear_efficiency)
    found = published.efficiencies(stage, np.zeros(1), np.array([published.STANDING_EFFICIENCY]))
    assert found.row[0] == pytest.approx(0.8605, abs=5e-5)
    assert found.total[0] == pytest.approx(total, abs=5e-5)
    assert found.total[0] == pytest.approx(0.8605 * gear_efficiency**2, abs=1e-4)

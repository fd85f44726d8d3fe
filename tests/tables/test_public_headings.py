# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Headings of public files: what each names, and what none of them is taken for."""

import pytest

from hmcvt_tools.tables.rules import meaning_of
from studies.tables.attacks import STROKES_OF_THE_MOTOR
from studies.tables.headings import PUBLIC_NAMES, PUBLIC_OTHERS
from studies.tables.truth import KINDS

UNITS = {
    "part": "%",
    "speed": "rpm",
    "torque": "Nm",
    "power": "kW",
    "temperature": "degC",
}
NAMED = [
    (quantity, name)
    for names in PUBLIC_NAMES.values()
    for quantity, listed in names.items()
    for name in listed
]
FOREIGN = [header for header, _, _ in PUBLIC_OTHERS]


def taken(header):
    """Return the quantity that a header is taken for without a question; `""` for none."""
    meaning = meaning_of(header)
    asked = meaning.unknown or meaning.problem or meaning.weak
    if asked or meaning.quantity.startswith("any_"):
        return ""
    return meaning.quantity


@pytest.mark.parametrize(("quantity", "name"), NAMED)
def test_a_heading_of_a_quantity_names_it(quantity, name):
    assert taken(f"{name} [{UNITS[KINDS[quantity]]}]") == quantity


@pytest.mark.parametrize("header", FOREIGN)
def test_a_foreign_heading_names_no_quantity(header):
    assert taken(header) == ""


@pytest.mark.parametrize("name", STROKES_OF_THE_MOTOR)
def test_the_stroke_of_the_motor_is_not_that_of_the_pump(name):
    assert taken(f"{name} [%]") == ""


@pytest.mark.parametrize(
    "header",
    [
        "Vitesse moteur hydraulique [tr/min]",
        "Couple du moteur hydraulique [Nm]",
        "Velocidad del motor hidr\u00e1ulico [rpm]",
        "Coppia motore idraulico [Nm]",
        "Drehzahl Motor hydraulisch [1/min]",
        "Hydraulikmotordrehzahl [1/min]",
    ],
)
def test_a_hydraulic_motor_is_not_the_engine(header):
    assert taken(header) == ""


@pytest.mark.parametrize(
    "header",
    [
        "Druckdifferenz HD [bar]",
        "Differenzdruck Hochdruck [bar]",
        "\u7cfb\u7edf\u538b\u5dee(MPa)",
    ],
)
def test_a_difference_over_the_high_pressure_is_that_of_the_loop(header):
    assert taken(header) == "pressure"


@pytest.mark.parametrize(
    "name", ["Hydraulikwirkungsgrad", "\u6db2\u538b\u6548\u7387", "Hydraulikleistung"]
)
def test_a_compound_with_the_hydraulics_is_of_them_alone(name):
    unit = "kW" if name.endswith("leistung") else "%"
    assert meaning_of(f"{name} [{unit}]").excluded

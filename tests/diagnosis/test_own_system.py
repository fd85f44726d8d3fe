# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A system that is no transmission: the fan of examples/own_system.py."""

import runpy
from functools import cache

import numpy as np
import pytest

import hmcvt_core as hmcvt
import hmcvt_tools
from tests.cli.running import ROOT

SCRIPT = ROOT / "examples" / "own_system.py"


@cache
def fan():
    return runpy.run_path(str(SCRIPT))


@cache
def diagnosed():
    return hmcvt.diagnose_system(fan()["Fan"](), fan()["simulated"]())


def test_script(capsys):
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert capsys.readouterr().out == diagnosed().report() + "\n"


def test_hidden_effect_is_found():
    diagnosis = diagnosed()
    assert diagnosis.verdict == "cause_found"
    assert diagnosis.sets[0].effects == ("bearing_drag",)
    size = diagnosis.causes[0].parameters["torque"]
    assert size["value"] == pytest.approx(0.15, abs=3.0 * size["standard_error"])
    friction = diagnosis.parameters["disc_friction"]
    drawn = 1e-5 * (2.0 + 0.5 * np.random.default_rng(1).standard_normal())
    assert friction.value == pytest.approx(drawn, abs=3.0 * friction.standard_error)
    assert friction.unit == "N m s2"
    assert diagnosis.model["covariance"].shape == (2, 2)
    errors = np.sqrt(np.diag(diagnosis.model["covariance"]))
    assert friction.standard_error == pytest.approx(1e-5 * errors[0])


def test_next_test_asks_for_a_point_of_the_system():
    first_ten = fan()["simulated"]().select(np.arange(10))
    found = hmcvt.diagnose_system(fan()["Fan"](), first_ten)
    test = found.next_tests[0]
    assert set(test.point) == {"speed", "flow"}
    assert f"{test.point['flow']:.2f} m3/s" in found.report()


def test_a_test_that_tells_nothing_is_not_asked_for():
    every_sixth = fan()["simulated"]().select(np.arange(0, 60, 6))
    found = hmcvt.diagnose_system(fan()["Fan"](), every_sixth)
    assert found.advice.reason == "settled"
    assert found.next_tests == ()


def test_page(tmp_path):
    hmcvt_tools.write_html(diagnosed(), tmp_path / "fan.html")
    page = (tmp_path / "fan.html").read_text(encoding="utf-8")
    for text in (
        "bearing drag",
        "flow [m3/s]",
        "disc friction",
        "What to measure next",
    ):
        assert text in page
    for text in ("engine", "Where the watts go", "pump damping", "fingerprint"):
        assert text not in page


def test_plot():
    figure = diagnosed().plot()
    assert len(figure.axes) == 2
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert diagnosed().plot(axes) is axes.figure
    assert axes.get_title().startswith("Saved model")


COLUMNS = {"speed": [100.0, 150.0], "flow": [0.5, 0.6], "efficiency": [0.6, 0.7]}


@pytest.mark.parametrize(
    ("changed", "noise", "message"),
    [
        ({"flow": None}, {}, "column flow is missing"),
        ({"efficiency": None}, {}, "column efficiency is missing"),
        ({"flow": [0.5]}, {}, "columns differ in length"),
        ({"flow": ["a", "b"]}, {}, "column flow holds no numbers"),
        ({"flow": [0.5, np.nan]}, {}, "column flow is not one row of finite numbers"),
        ({}, {"efficiency": 0.0}, "noise of efficiency is not positive"),
    ],
)
def test_bad_columns_are_named(changed, noise, message):
    columns = {**COLUMNS, **changed}
    columns = {name: row for name, row in columns.items() if row is not None}
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.observe_system(fan()["Fan"](), columns, noise=noise)


def test_noise_of_a_channel_is_assumed_unless_stated():
    system = fan()["Fan"]()
    assumed = hmcvt.observe_system(system, COLUMNS)
    assert assumed.assumed
    np.testing.assert_allclose(assumed.deviation[0], [0.003, 0.0035])
    assert assumed.noise_source == "assumed, uncertainty of efficiency"
    stated = hmcvt.observe_system(system, COLUMNS, noise={"efficiency": [0.1, 0.2]})
    assert not stated.assumed
    np.testing.assert_allclose(stated.deviation[0], [0.1, 0.2])

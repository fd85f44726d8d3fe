# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What every result offers: plain data, text, a picture, standard errors and the seed."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import hmcvt_core as hmcvt
from hmcvt_core.diagnosis.selection.explanation import without_absent
from hmcvt_core.transmission.parameters import PARAMETER_NAMES
from studies.watch import NOISE, stream, well_known

from .campaigns import BASE, campaign, diagnosed


@pytest.fixture(scope="module")
def opening():
    model = well_known()
    return hmcvt.watch(model, stream(model, 1, "step", 0.02), noise=NOISE)


@pytest.mark.parametrize("name", ["nothing", "planetary mesh"])
def test_saved_models_keep_standard_errors(name, tmp_path):
    diagnosis = diagnosed(name)
    hmcvt.save_model(diagnosis.model, tmp_path / "model.yaml")
    saved = hmcvt.load_model(tmp_path / "model.yaml")
    assert set(saved.standard_errors) == set(PARAMETER_NAMES)
    assert saved.correlation.shape == (3, 3)
    prediction = saved.predict(0.3, 150.0, 200.0)
    assert 0.0 < prediction.standard_error < 0.02
    for parameter in PARAMETER_NAMES:
        estimate = diagnosis.parameters[parameter]
        assert estimate.value == getattr(diagnosis.model.parameters, parameter)
        assert estimate.standard_error == pytest.approx(
            saved.standard_errors[parameter], rel=2e-3
        )
        error = estimate.value - getattr(BASE.parameters, parameter)
        assert abs(error) < 4.0 * estimate.standard_error


def test_an_effect_whose_error_holds_zero_is_no_cause():
    explanation, _ = diagnosed("charge pump").posterior.entries[0]
    assert not explanation.may_be_zero.any() and explanation.names
    model = explanation.plain_model
    wide = replace(model, covariance=1e6 * model.covariance)
    doubtful = replace(explanation, plain_model=wide)
    assert doubtful.may_be_zero.all() and not without_absent(doubtful).names


def test_parameters_and_seed_are_plain_data():
    diagnosis = diagnosed("planetary mesh")
    data = diagnosis.to_dict()
    assert data["seed"] == diagnosis.seed == 0
    assert data["parameters"].keys() == {*PARAMETER_NAMES, "gear_loss"}
    assert data["parameters"]["leakage"]["unit"] == "m3/(s Pa)"
    size = diagnosis.causes[0].parameters["loss"]
    low, high = size["interval"]
    assert high - low == pytest.approx(2.0 * 1.96 * size["standard_error"], rel=1e-6)


def test_reports_print_fitted_shapes():
    diagnosis = diagnosed("leakage")
    shapes = {
        name: entry
        for name, entry in diagnosis.causes[0].parameters.items()
        if "interval" not in entry
    }
    assert shapes
    text = " ".join(diagnosis.report().split())
    for name, entry in shapes.items():
        assert f"{name} = {entry['value']:.3g}" in text
        assert entry["meaning"] in text


def test_advice_has_text_and_seed():
    samples = campaign(seed=3, n=16)
    advice = hmcvt.next_test(BASE, samples, seed=5)
    assert advice.seed == 5
    assert advice.report().splitlines()[-1].strip()
    assert advice._repr_html_().startswith("<pre>")


def test_watch_is_plain_data_and_text(opening):
    data = opening.to_dict()
    assert data["open"] and "trace" not in data
    assert opening.report() == str(opening)
    low, high = opening.interval
    assert opening.standard_error == pytest.approx((high - low) / (2.0 * 1.96))


def test_pictures_go_into_axes(opening):
    plan = campaign(seed=3, n=48)
    for result in (
        diagnosed("nothing"),
        opening,
        hmcvt.separable(BASE, plan, noise=NOISE),
    ):
        assert result.plot().axes
        axes = Figure().subplots()
        assert result.plot(axes) is axes.figure
        assert axes.get_xlabel()
    trace = opening.trace
    assert len(trace.sample) == opening.samples
    assert np.isfinite(trace.residuals).all()


@pytest.mark.long
def test_validation_is_another_name_of_holdout():
    samples = campaign(seed=1, n=24)
    later = campaign(seed=2, n=12)
    first = hmcvt.diagnose(BASE, samples, holdout=later, noise=0.004)
    second = hmcvt.diagnose(BASE, samples, validation=later, noise=0.004)
    assert first.to_dict() == second.to_dict()
    assert first.shrinkage.on == "holdout"

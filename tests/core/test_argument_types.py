# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Arguments of another type are refused with a line that says what is wanted."""

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import yaml

import hmcvt_core as hmcvt

MODEL = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
SAMPLES = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
FRAME = SAMPLES.to_dataframe()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: hmcvt.identify(FRAME),
            r"samples: BenchSamples is wanted, not a pandas Da.*from_d",
        ),
        (
            lambda: hmcvt.identify("bench.csv"),
            r"not the text 'bench\.csv'; read them by read_bench",
        ),
        (
            lambda: hmcvt.identify([0.1, 0.2]),
            "samples: BenchSamples is wanted, not a list",
        ),
        (
            lambda: hmcvt.identify(MODEL),
            "an EfficiencyModel; are model and samples swapped",
        ),
        (
            lambda: hmcvt.identify(SAMPLES, stage="HM3"),
            "stage: a Stage is wanted, not the text 'HM3'",
        ),
        (lambda: hmcvt.identify(SAMPLES, stage=MODEL), "take its attribute stage"),
        (
            lambda: hmcvt.identify(SAMPLES, effects=["churning"]),
            r"effects\[0\]: an Effect object is wa",
        ),
        (
            lambda: hmcvt.identify(SAMPLES, effects="churning"),
            "effects: a list of Effect objects is w",
        ),
        (
            lambda: hmcvt.identify(SAMPLES, holdout=FRAME),
            "holdout: BenchSamples is wanted",
        ),
        (
            lambda: hmcvt.identify(SAMPLES, holdout=SAMPLES, validation=SAMPLES),
            "one argument: give holdout",
        ),
        (
            lambda: hmcvt.diagnose(SAMPLES, MODEL),
            "model: an EfficiencyModel is wanted, not a Bench.*sw",
        ),
        (
            lambda: hmcvt.diagnose(MODEL, FRAME),
            "convert it by BenchSamples.from_dataframe",
        ),
        (lambda: hmcvt.diagnose("hm4.yaml", SAMPLES), "read it by load_model"),
        (
            lambda: hmcvt.diagnose(MODEL, SAMPLES, [1.0]),
            "holdout: BenchSamples is wanted, not a list",
        ),
        (
            lambda: hmcvt.next_test(SAMPLES, MODEL),
            "model: an EfficiencyModel is wanted",
        ),
        (lambda: hmcvt.identify(SAMPLES, seed="a"), "seed = 'a' is not a whole number"),
        (lambda: hmcvt.diagnose(MODEL, SAMPLES, seed="a"), "seed = 'a' is not a whole"),
        (lambda: hmcvt.next_test(MODEL, SAMPLES, seed=-1), "seed = -1 is not a whole"),
        (lambda: hmcvt.diagnose(MODEL, SAMPLES, seed=True), "seed = True is not a"),
        (
            lambda: MODEL.optimal_drive(120.0, 4e4, engine="engine.yaml"),
            "engine: an Engine is wanted.*read it by load_engine",
        ),
        (
            lambda: MODEL.optimal_displacement_ratio("100", 100.0),
            "engine_speed = '100' is not a number",
        ),
        (
            lambda: MODEL.optimal_displacement_ratio(
                100.0, 100.0, hold="output_speed", output_speed="120"
            ),
            "output_speed = '120' is not a number",
        ),
        (lambda: hmcvt.separable(MODEL, FRAME), "samples: BenchSamples is wanted"),
        (lambda: hmcvt.watch(SAMPLES, MODEL), "model: an EfficiencyModel is wanted"),
        (
            lambda: hmcvt.watch(MODEL, SAMPLES, false_alarms=True),
            "false_alarms = True is not a number",
        ),
        (
            lambda: hmcvt.watch(MODEL, SAMPLES, false_alarms=float("nan")),
            "false_alarms = nan is not finite",
        ),
        (
            lambda: hmcvt.load_model(MODEL),
            "path: the path of a parameter file is wanted, not an Eff",
        ),
        (
            lambda: hmcvt.read_bench(FRAME),
            "path: the path of a bench file is wanted, not a pandas Da",
        ),
        (
            lambda: hmcvt.write_bench(SAMPLES, "x.csv"),
            r"the order is \(path, samples\)",
        ),
        (
            lambda: hmcvt.save_model("x.yaml", MODEL),
            "model: an EfficiencyModel is wanted",
        ),
        (lambda: hmcvt.BenchSamples.from_dataframe("x.csv"), "read it by read_bench"),
        (
            lambda: replace(MODEL, effects=("churning",)),
            r"effects\[0\]: an Effect object",
        ),
        (
            lambda: replace(MODEL, parameters=(1.0, 2.0)),
            "HydraulicParameters is wanted, not a tuple",
        ),
        (
            lambda: hmcvt.EfficiencyModel("HM4", MODEL.parameters),
            r"stage\[0\]: a Stage is wanted",
        ),
    ],
)
def test_what_is_wanted_is_said(call, message):
    with pytest.raises(hmcvt.InputError, match=message) as caught:
        call()
    assert len(str(caught.value).splitlines()) == 1


READERS = (
    (hmcvt.load_model, "a parameter file"),
    (hmcvt.load_stage, "a transmission file"),
    (hmcvt.load_engine, "an engine file"),
)
FILES = (
    ("params/hm4.yaml", "a parameter file of a model"),
    ("params/transmission.yaml", "a transmission file"),
    ("params/engine.yaml", "an engine file"),
)


@pytest.mark.parametrize(("read", "wanted"), READERS)
@pytest.mark.parametrize(("file", "kind"), FILES)
def test_readers_name_the_kind_given_and_the_one_wanted(read, wanted, file, kind):
    path = hmcvt.data_path(file)
    text = Path(path).read_text(encoding="utf-8")
    given = {
        f"the text of {kind}": text,
        f"the content of {kind} as a dict": yaml.safe_load(text),
    }
    for description, value in given.items():
        message = f"the path of {wanted} is wanted, not {description}"
        with pytest.raises(hmcvt.InputError, match=message):
            read(value)
    if kind.startswith(wanted):
        return
    for value in (str(path), Path(path)):
        with pytest.raises(
            hmcvt.InputError, match=f"is {kind}; wanted is {wanted}"
        ) as caught:
            read(value)
        assert len(str(caught.value).splitlines()) == 1


def test_a_table_is_not_taken_for_a_parameter_file():
    table = hmcvt.data_path("data/table2.csv")
    with pytest.raises(
        hmcvt.InputError, match=r"is a table \(\.csv\); wanted is a para"
    ):
        hmcvt.load_model(table)
    with pytest.raises(hmcvt.InputError, match="bench file is wanted, not the text of"):
        hmcvt.read_bench(Path(table).read_text(encoding="utf-8"))


def test_validation_is_the_former_name_of_holdout():
    now = hmcvt.identify(SAMPLES.select(range(5)), holdout=SAMPLES.select([5, 6]))
    before = hmcvt.identify(SAMPLES.select(range(5)), validation=SAMPLES.select([5, 6]))
    assert now.prediction_error == before.prediction_error is not None


def test_a_dataframe_gives_the_samples_and_back():
    again = hmcvt.BenchSamples.from_dataframe(FRAME)
    assert again.columns.keys() == SAMPLES.columns.keys()
    for name, values in SAMPLES.columns.items():
        np.testing.assert_array_equal(again.columns[name], values)
    assert again.extra == SAMPLES.extra
    pd.testing.assert_frame_equal(again.to_dataframe(), FRAME)


def test_a_dataframe_is_checked_as_a_file_is():
    with pytest.raises(hmcvt.InputError, match="column load_torque is missing"):
        hmcvt.BenchSamples.from_dataframe(FRAME.drop(columns="load_torque"))
    with pytest.raises(hmcvt.InputError, match="column efficiency occurs twice"):
        hmcvt.BenchSamples.from_dataframe(FRAME.assign(Efficiency=0.8))
    with pytest.raises(hmcvt.InputError, match="a fraction, not percent"):
        hmcvt.BenchSamples.from_dataframe(FRAME.assign(efficiency=80.0))
    with pytest.raises(hmcvt.InputError, match=r"engine_speed = .* is not a number"):
        hmcvt.BenchSamples.from_dataframe(FRAME.assign(engine_speed="fast"))


@pytest.mark.parametrize("missing", [None, np.nan, pd.NA])
def test_a_missing_text_is_an_empty_cell_as_in_a_file(tmp_path, missing):
    sessions = ["1", missing] * (len(SAMPLES) // 2)
    frame = FRAME.iloc[: len(sessions)].assign(session=sessions)
    frame.to_csv(tmp_path / "bench.csv", index=False)
    of_file = hmcvt.read_bench(tmp_path / "bench.csv").extra["session"]
    assert hmcvt.BenchSamples.from_dataframe(frame).extra["session"] == of_file
    assert set(of_file) == {"1", ""}


@pytest.mark.parametrize("value", ["30", True, ["30"]])
@pytest.mark.parametrize("name", ["efficiency", "breakdown", "refusal", "predict"])
def test_an_oil_temperature_is_a_number(name, value):
    with pytest.raises(hmcvt.InputError, match=r"oil_temperature = .* is not a number"):
        getattr(MODEL, name)(0.3, 150.0, 200.0, oil_temperature=value)


@pytest.mark.parametrize("value", ["30", True])
def test_the_oil_temperature_of_an_optimum_is_a_number(value):
    with pytest.raises(hmcvt.InputError, match=r"oil_temperature = .* is not a number"):
        MODEL.optimal_displacement_ratio(150.0, 200.0, oil_temperature=value)
    with pytest.raises(hmcvt.InputError, match=r"oil_temperature = .* is not a number"):
        MODEL.optimal_drive(120.0, 4e4, oil_temperature=value)


def test_samples_name_their_stage():
    assert SAMPLES.stage is None
    staged = replace(SAMPLES, extra={"stage": ("HM4",) * len(SAMPLES)})
    assert staged.stage.tolist() == ["HM4"] * len(SAMPLES)


TRACTOR = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))


@pytest.mark.parametrize(
    "name",
    ["efficiency", "output_speed", "power_loss", "predict", "refusal", "breakdown"],
)
@pytest.mark.parametrize("stroke", [0.3, [0.3, 0.5]])
def test_several_stages_need_a_name(name, stroke):
    with pytest.raises(
        hmcvt.InputError, match=r"the model has the stages .*HM3.*: name the one"
    ):
        getattr(TRACTOR, name)(stroke, 150.0, 200.0)
    alone = getattr(TRACTOR.stages["HM3"], name)(stroke, 150.0, 200.0)
    named = getattr(TRACTOR, name)(stroke, 150.0, 200.0, stage="HM3")
    np.testing.assert_equal(
        vars(named) if name == "breakdown" else named,
        vars(alone) if name == "breakdown" else alone,
    )


def test_optimum_of_several_stages_needs_a_name():
    with pytest.raises(hmcvt.InputError, match="name the one engaged"):
        TRACTOR.optimal_displacement_ratio(150.0, 200.0)
    one = TRACTOR.stages["HM3"].optimal_displacement_ratio(150.0, 200.0)
    assert TRACTOR.optimal_displacement_ratio(150.0, 200.0, stage="HM3") == one


def test_map_of_a_named_stage():
    axes = [[0.0, 0.5], [150.0], [200.0]]
    named = TRACTOR.efficiency_map(*axes, stage="HM3").efficiency
    alone = TRACTOR.stages["HM3"].efficiency_map(*axes).efficiency
    np.testing.assert_array_equal(named, alone)


def test_results_speak_one_grammar():
    fit = hmcvt.identify(SAMPLES)
    results = [
        MODEL,
        fit,
        MODEL.efficiency_map([-0.5, 0.0, 0.5], [100.0, 150.0], [100.0, 200.0]),
        MODEL.predict(0.3, 150.0, 200.0),
        MODEL.optimal_displacement_ratio([100.0, 150.0], 200.0),
        MODEL.optimal_drive(100.0, 2e4),
    ]
    for result in results:
        assert isinstance(result.to_dict(), dict) and result.report()
    for result in results[:3]:
        figure, ax = plt.subplots()
        assert result.plot(ax=ax) is figure and ax.get_title()
        plt.close(figure)
        assert result.plot().axes


def test_lists_and_integers_are_numbers():
    values = MODEL.efficiency([0, 0.5], 150, [200, 300])
    assert values.shape == (2,)
    assert values[0] == MODEL.efficiency(0.0, 150.0, 200.0)
    assert isinstance(MODEL.efficiency(0.0, 150.0, 200.0), float)

# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Signals of a control unit: a status for each, a substitute where the model has no answer."""

import ctypes
import math

import pytest

from export.conftest import STAGES

STALLED, DRAGGED = 4, 5
VALID, EXTRAPOLATED, SUBSTITUTED = 0, 1, 2
SIGNALS = ("efficiency", "output_speed", "engine_torque", "power_loss")
INSTEAD = (-1.0, -2.0, -3.0, -4.0)


class Signal(ctypes.Structure):
    _fields_ = (("value", ctypes.c_double), ("status", ctypes.c_int))


class Signals(ctypes.Structure):
    _fields_ = tuple((name, Signal) for name in SIGNALS)


def signals(built, number, *point):
    """Return the code, and value and status of each signal by name."""
    parameters = (ctypes.c_double * 3)(*built.library.parameters)
    out = Signals()
    code = built.library.library.hmcvt_predict_signals(
        parameters,
        number,
        *map(ctypes.c_double, point),
        (ctypes.c_double * 4)(*INSTEAD),
        ctypes.byref(out),
    )
    pairs = {}
    for name in SIGNALS:
        signal = getattr(out, name)
        pairs[name] = (signal.value, signal.status)
    return code, pairs


def test_answers_are_valid_inside_the_data_and_extrapolated_outside(exported):
    built = exported("hm4")
    model = built.model
    inside = [0.5 * sum(getattr(model.domain, axis)) for axis in model.domain.to_dict()]
    code, found = signals(built, 0, *inside)
    assert code == 0
    assert found["efficiency"] == (model.efficiency(*inside), VALID)
    assert found["output_speed"] == (model.output_speed(*inside), VALID)
    outside = (inside[0], inside[1], 2.0 * model.domain.load_torque[1])
    code, found = signals(built, 0, *outside)
    assert code == 0
    assert found["efficiency"] == (model.efficiency(*outside), EXTRAPOLATED)


def test_stall_gives_substitutes_and_a_code_of_its_own(exported):
    built = exported("hm4")
    point = (0.05, 60.0, 4900.0)
    assert math.isnan(built.model.output_speed(*point))
    code, found = signals(built, 0, *point)
    assert code == STALLED
    for name, value in zip(SIGNALS, INSTEAD, strict=True):
        assert found[name] == (value, SUBSTITUTED)


def test_drag_in_overrun_gives_the_other_signals_and_a_code_of_its_own(exported):
    built = exported("hm4")
    point = (0.3, 200.0, -1.0)
    assert math.isnan(built.model.efficiency(*point))
    code, found = signals(built, 0, *point)
    assert code == DRAGGED
    assert found["efficiency"] == (INSTEAD[0], SUBSTITUTED)
    speed, status = found["output_speed"]
    assert speed == built.model.output_speed(*point)
    assert status in (VALID, EXTRAPOLATED)


@pytest.mark.parametrize(
    ("number", "point", "code"),
    [
        (0, (math.nan, 150.0, 100.0), 2),
        (0, (0.5, math.inf, 100.0), 2),
        (0, (0.5, 150.0, math.nan), 2),
        (-1, (0.5, 150.0, 100.0), 3),
    ],
)
def test_what_is_refused_holds_substitutes(exported, number, point, code):
    returned, found = signals(exported("hm4"), number, *point)
    assert returned == code
    for name, value in zip(SIGNALS, INSTEAD, strict=True):
        assert found[name] == (value, SUBSTITUTED)


def test_any_output_becomes_a_signal(exported):
    library = exported("hm4").library.library
    library.hmcvt_signal_of.restype = Signal
    library.hmcvt_signal_of.argtypes = (ctypes.c_double, ctypes.c_double)
    for output in (math.nan, math.inf, -math.inf):
        signal = library.hmcvt_signal_of(output, 7.0)
        assert (signal.value, signal.status) == (7.0, SUBSTITUTED)
    signal = library.hmcvt_signal_of(0.5, 7.0)
    assert (signal.value, signal.status) == (0.5, VALID)


@pytest.mark.parametrize(("name", "stage"), STAGES)
def test_rows_of_constants_name_stage_and_gear_pairs(exported, name, stage):
    built = exported(name)
    source = (built.folder / "hmcvt_model.c").read_text(encoding="utf-8")
    assert f"/* {stage}, output forward" in source
    assert ".gear = R(" in source
    for pair in built.model.stages[stage].stage.gear_pairs:
        assert f"{pair.name} (ratio {pair.ratio:g}" in source.replace("\n * ", " ")

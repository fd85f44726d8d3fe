# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects that no test distinguishes are one class: in sets, verdicts, words and advice."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.design.next_test import candidates_of, with_twins
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.diagnosis.results import text as words
from hmcvt_core.diagnosis.selection.classes import (
    ClassSet,
    EffectClass,
    find_classes,
    merge_sets,
    with_probabilities,
)
from hmcvt_core.diagnosis.selection.posterior import Posterior
from hmcvt_core.diagnosis.statements.agreement import NOTHING_STATED
from hmcvt_core.diagnosis.statements.verdict import word_of
from hmcvt_core.physics.effects.hydraulic import PressureLeakage
from hmcvt_core.physics.effects.mechanical import (
    BearingDrag,
    ChargePump,
    Churning,
    ClutchDrag,
    GearEfficiency,
)
from hmcvt_core.physics.effects.sensor import (
    EngineTorqueGain,
    EngineTorqueZero,
    OutputTorqueZero,
)

from .campaigns import BASE, NOISE, diagnosed, random_points

CONSTANT_TORQUE = {"charge_pump", "bearing_drag", "torque_sensor"}


def _class(members, *sets):
    count = len(members)
    return EffectClass(
        members, ("",) * count, ("",) * count, ("",) * count, "", 0.5, tuple(sets)
    )


def _posterior(*sets, model=BASE):
    """A posterior over sets of effects as they are, on a campaign without a gap."""
    points = random_points(seed=3)
    efficiency = model.readings_at(points)["efficiency"]
    carried = (efficiency > 0.1) & (efficiency < 1.0)
    columns = [values[carried] for values in (*points[:3], efficiency)]
    samples = hmcvt.BenchSamples(*columns, source="simulated")
    base = refit(Hypothesis(Transmission(model)), observe(samples, NOISE))
    entries = []
    for effects, probability in sets:
        sizes = [
            effect.values()[effect.sizes()[0].name] / effect.sizes()[0].typical
            for effect in effects
        ]
        explanation = SimpleNamespace(
            names=tuple(sorted(effect.name for effect in effects)),
            absent=(),
            fit=SimpleNamespace(
                effects=effects,
                sizes=np.array(sizes),
                hypothesis=SimpleNamespace(reversed_sign=False),
            ),
            is_base_discrepancy=False,
            is_listed_set=True,
            explained_fraction=lambda base_only: 1.0,
            log_evidence=0.0,
            discrepancy=None,
        )
        entries.append((explanation, probability))
    return Posterior(tuple(entries), SimpleNamespace(fit=base), 0.0)


def _members(*sets, model=BASE):
    return [set(item.members) for item in find_classes(_posterior(*sets, model=model))]


def test_constant_torque_of_the_engine_is_one_class():
    assert _members(
        ((ChargePump(6.0),), 0.4),
        ((BearingDrag(10.0, 0.2),), 0.3),
        ((EngineTorqueZero(8.0),), 0.2),
        ((Churning(10.0, 2.0),), 0.05),
        ((ClutchDrag(6.0),), 0.05),
    ) == [CONSTANT_TORQUE]


@pytest.mark.parametrize(
    "effects",
    [
        (ChargePump(6.0), OutputTorqueZero(8.0)),
        (ChargePump(6.0), EngineTorqueZero(-8.0)),  # no charge pump drives the engine
        (BearingDrag(10.0, 0.67), Churning(10.0, 2.0)),
        (ChargePump(0.1), PressureLeakage(1e-14)),  # too small for any test to show
        (ChargePump(12.0), PressureLeakage(2e-11)),
        (EngineTorqueGain(0.03), EngineTorqueZero(8.0)),  # one name
    ],
    ids=lambda effects: " and ".join(effect.form or effect.name for effect in effects),
)
def test_effects_that_tests_distinguish_are_no_class(effects):
    one, other = effects
    assert _members(((one,), 0.6), ((other,), 0.4)) == []


def test_gain_of_a_meter_and_gear_mesh_are_alike_without_a_planetary_row():
    hydrostatic = hmcvt.load_model(hmcvt.data_path("params/hydrostatic.yaml"))
    sets = (((GearEfficiency(0.01),), 0.6), ((EngineTorqueGain(0.02),), 0.4))
    assert _members(*sets, model=hydrostatic) == [{"gear_mesh", "torque_sensor"}]
    assert _members(*sets) == []


def test_meter_comes_first_then_the_more_probable():
    (effects,) = find_classes(
        _posterior(
            ((BearingDrag(10.0, 0.0),), 0.4),
            ((ChargePump(6.0),), 0.3),
            ((EngineTorqueZero(8.0), PressureLeakage(2e-11)), 0.2),
        )
    )
    assert effects.members == ("torque_sensor", "bearing_drag", "charge_pump")
    assert effects.components == ("sensor", "gears", "pump")
    assert effects.component == "gears"
    assert effects.forms[0] == "zero of the engine meter"
    assert effects.probability == pytest.approx(0.9)
    assert effects.sets[-1] == ("pressure_leakage", "torque_sensor")
    assert effects.sentence == (
        "No test distinguishes torque sensor (zero of the engine meter), bearing drag and charge "
        "pump: they change the readings alike (one of them: 90 %). First check the meter's zero "
        "before and after the campaign; calibrate it with a dead weight."
    )


def test_sets_that_differ_by_members_of_a_class_are_merged():
    sets = [
        (("a", "x"), 0.3),
        (("x",), 0.25),
        (("b", "x"), 0.2),
        (("a",), 0.1),
        (("a", "b"), 0.05),
        (("b", "y"), 0.02),
    ]
    # In the set with y, b has another form.
    classes = [_class(("b", "a"), *(names for names, _ in sets[:-1]))]
    merged = merge_sets(sets, classes)
    assert merged == (
        ClassSet((("b", "a"), ("x",)), pytest.approx(0.5), (("a", "x"), ("b", "x"))),
        ClassSet((("x",),), 0.25, (("x",),)),
        ClassSet((("b", "a"),), pytest.approx(0.15), (("a",), ("a", "b"))),
        ClassSet((("b",), ("y",)), 0.02, (("b", "y"),)),
    )
    assert with_probabilities(merged, "{0} {1}") == [
        "(b or a) + x 50 %",
        "x 25 %",
        "one of them 15 %",
        "b + y 2 %",
    ]
    assert merge_sets(sets, ()) == tuple(
        ClassSet(tuple((name,) for name in names), p, (names,)) for names, p in sets
    )


@pytest.mark.parametrize(
    ("classes", "verdict"),
    [((), "ambiguous"), ((_class(("b", "a"), ("a",), ("b",)),), "class_found")],
)
def test_a_class_is_a_cause(classes, verdict):
    base = SimpleNamespace(names=(), low=np.array([]), high=np.array([]))
    system = SimpleNamespace(base=base)
    hypothesis = SimpleNamespace(system=system, free_parameters=[])
    fit = SimpleNamespace(effects=(), base=np.array([]), hypothesis=hypothesis)
    posterior = Posterior(
        tuple(
            (
                SimpleNamespace(
                    names=names,
                    is_listed_set=True,
                    explained_fraction=lambda base_only: 1.0,
                    log_evidence=0.0,
                    discrepancy=None,
                    form_error="",
                    absent=(),
                    fit=fit,
                    model=SimpleNamespace(covariance=np.zeros((0, 0))),
                    served_fit=fit,
                ),
                p,
            )
            for names, p in ((("a",), 0.5), (("b",), 0.4), (("a", "c"), 0.1))
        ),
        SimpleNamespace(),
        0.0,
    )
    leading = (posterior.entries[0][0], 0.5)
    class_sets = merge_sets(
        [(names, p) for names, (_, p) in posterior.sets.items()], classes
    )
    analysis = SimpleNamespace(
        significant=True,
        posterior=posterior,
        leading=leading,
        leading_class_set=class_sets[0],
    )
    assert word_of(analysis, NOTHING_STATED, ()) == (verdict, ())


def test_advice_does_not_choose_tests_between_twins():
    posterior = _posterior(
        ((PressureLeakage(2e-11),), 0.4),
        ((ChargePump(6.0),), 0.3),
        ((EngineTorqueZero(8.0),), 0.25),
    )
    candidates = candidates_of(posterior)[:-1]
    merged = with_twins(candidates, find_classes(posterior))
    assert [item.label.effects for item in merged] == [
        ("charge_pump",),
        ("pressure_leakage",),
    ]
    assert merged[0].probability == pytest.approx(0.55)
    assert [item.label.effects for item in merged[0].twins] == [("torque_sensor",)]


def test_diagnosis_names_a_class_once():
    found = diagnosed("a twin and another")
    (effects,) = found.classes
    assert set(effects.members) == CONSTANT_TORQUE
    assert effects.members[0] == "torque_sensor"
    leading = found.class_sets[0]
    assert set(leading.alternatives) == {("pressure_leakage",), effects.members}
    # An accessory at constant power takes nearly the same, and is told apart by more tests.
    assert leading.probability > 0.7 > found.sets[0].probability
    assert found.sets[0].effects in leading.sets
    text = " ".join(found.report().split())
    assert text.count(effects.sentence) == 1
    assert text.count("torque sensor, ") <= 4  # headline, verdict, members and sets
    assert f"{leading} (" in text
    assert words.mechanic(found).startswith("Probably pressure leakage")
    advice = found.advice
    assert advice.reason == "cannot be settled by tests"
    assert advice.measure.startswith("check the meter's zero")
    assert [test.point for test in found.next_tests] == [None]


def test_json_has_the_class():
    found = diagnosed("a twin and another")
    (data,) = json.loads(json.dumps(found.to_dict()))["classes"]
    (effects,) = found.classes
    assert data["members"] == list(effects.members)
    assert data["components"][0] == "sensor"
    assert data["sentence"] == effects.sentence
    assert data["probability"] == pytest.approx(effects.probability)
    assert diagnosed("planetary mesh").to_dict()["classes"] == []
    assert diagnosed("nothing").to_dict()["classes"] == []


def test_outcome_without_classes_has_every_set_alone():
    found = replace(diagnosed("a twin and another"), classes=())
    assert [item.sets for item in found.class_sets] == [
        (item.effects,) for item in found.sets
    ]
